"""Backlash shows as bursts: recognised by where the energy lies rather than by a column."""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.motion import Array

FAST = 5.0  # Hz: slower than this no burst is
SHARE_FAST = 0.55  # of the excess energy that must lie above FAST
SHARE_NEAR = 0.65  # of the fast energy that must lie after a reversal of the load
AFTER = 0.25  # s after a reversal within which its burst dies away


def bursts(evidence: Evidence, joint: int) -> bool:
    """Return whether a joint's residual is made of bursts after reversals of its load."""
    fast = near = excess = random = 0.0
    torques = [evidence.structure.torques(t.motion, evidence.values) for t in evidence.trajectories]
    for trajectory, residual, torque in zip(evidence.trajectories, evidence.residual, torques, strict=True):
        measured = trajectory.measured
        if measured.base_frequency is None or measured.decimate != 1:
            return False
        r = residual[:, joint]
        spectrum = np.fft.rfft(r)
        spectrum[np.arange(len(spectrum)) * measured.base_frequency < FAST] = 0.0
        high = np.fft.irfft(spectrum, len(r))
        lines = float(np.sum(spectrum != 0.0)) * 2.0
        rows = _after_reversals(torque.load[:, joint], round(AFTER / measured.dt))
        share = float(rows.mean())
        excess += float(np.sum(r**2)) - float(trajectory.dof[joint])
        fast += float(np.sum(high**2)) - lines
        near += float(np.sum(high[rows] ** 2)) - lines * share
        random += share
    if excess <= 0.0 or fast <= 0.0:
        return False
    # bursts that chance would put near a reversal don't count
    return fast > SHARE_FAST * excess and near > max(SHARE_NEAR, random / len(torques) + 0.3) * fast


def _after_reversals(load: Array, reach: int) -> np.ndarray:
    """Return the samples that follow a change of sign of the load within `reach`, or precede it by a tenth of that."""
    change = np.flatnonzero(np.sign(load) != np.sign(np.roll(load, 1)))
    rows = np.zeros(len(load), dtype=bool)
    for place in change:
        rows[np.arange(place - reach // 10, place + reach) % len(load)] = True
    return rows
