"""Does a recording repeat as a whole, or only its commanded motion?"""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array
from robot_ident.recording.clock import roughness
from robot_ident.recording.measurement import Measurement

_STRAY = 30.0  # times its noise: how far the position may stray from one period to the next
_BURSTS = 8.0  # kurtosis of the torque's scatter about the mean period; noise has 3, coloured noise little more
_SMOOTH = 0.5  # correlation of that scatter from one sample to the next; bursts last longer than a sample
_STRAYS = 3.0  # times its noise: how far the position may stray from period to period without a second look
_KEPT = 0.5  # of the recording that periods should hold
_CALMER, _MORE = 0.25, 1.5  # variance of the positions, and share of the recording, for which cycles are preferred


def doubtful(variance: Array, samples: int, q: Array) -> bool:
    """Return whether the positions q [N, n] stray more from period to period than noise does, by their variance [n]
    about the mean, or whether periods hold few of the samples: cycles that start when they may look like periods that
    are not quite kept.
    """
    strays = np.sqrt(variance) > _STRAYS * np.maximum(roughness(q), 1e-12)
    return bool(strays.any()) or samples < _KEPT * len(q)


def better(variance: Array, samples: int, beside: Array, samples_beside: int) -> bool:
    """Return whether aligned cycles repeat far better than periods, or hold far more samples; see `doubtful`."""
    calmer = float(np.mean(variance / np.maximum(beside, 1e-300))) < _CALMER
    return calmer or samples > _MORE * samples_beside


def disturbed(measured: Measurement, step: Array) -> tuple[int, ...]:
    """Return the joints whose torque has bursts of its own in each period and moves the arm by them.

    measured: periods averaged. step [n]: noise of a position sample, judged from sample to sample. Such torque (pushes,
    contacts, added pulses) is no noise: averaging blurs it, and its scatter would pass for a noise floor.
    """
    periods = measured.period_torque
    if periods is None:
        return ()
    found = []
    for joint in range(periods.shape[2]):
        x = periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0)
        power = float(np.nanmean(x**2))
        if not power > 0.0:
            continue
        bursts = float(np.nanmean(x**4)) / power**2
        smooth = float(np.nanmean(x[:, 1:] * x[:, :-1])) / power
        strays = np.sqrt(measured.position_variance[joint]) > _STRAY * step[joint]
        if strays and bursts > _BURSTS and smooth > _SMOOTH:
            found.append(int(joint))
    return tuple(found)
