"""Drift of friction with temperature: invisible in an average of periods, a trend from period to period."""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.motion import Array


def drift_gain(evidence: Evidence) -> Array:
    """Return for every joint [n] how much a linear trend of its viscous friction gains, in units of chi-square.

    For period m the viscous friction beyond the mean is b_m = sum v (tau_m - mean tau) / sum v^2, with variance s^2 /
    sum v^2; the squared slope of b_m over m, in units of its variance, is chi-square with one degree of freedom for
    each recording.
    """
    gain = np.zeros(evidence.structure.robot.n)
    for trajectory in evidence.trajectories:
        measured = trajectory.measured
        periods = measured.period_torque
        if periods is None or len(periods) < 4:
            continue
        number = np.arange(len(periods)) - (len(periods) - 1) / 2.0
        for joint in range(len(gain)):
            v = measured.motion.dq[:, joint]
            power = float(v @ v)
            extra = np.nan_to_num(periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0))
            if power <= 0.0:
                continue
            trend = float(number @ (extra @ v))
            gain[joint] += trend**2 / (measured.torque_variance[joint] * power * float(number @ number))
    return gain
