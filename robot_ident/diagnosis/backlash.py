"""Backlash shows as bursts: recognised by where the energy lies rather than by a column."""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.hidden_path import residual_beside_hidden_path
from robot_ident.motion import Array, Mask

FAST = 5.0  # Hz: slower than this no burst is
SHARE_FAST = 0.55  # of the excess energy that must lie above FAST
SHARE_NEAR = 0.65  # of the fast energy that must lie after a reversal of the load
CHANCE = 0.3  # beyond the share that chance would put there
AFTER = 0.25  # s after a reversal within which its burst dies away


def burst_cause(evidence: Evidence, joint: int) -> int | None:
    """Return the joint after whose load reversals the bursts in a joint's residual come, None where it has no bursts.

    A gap in one joint rattles its neighbours too; the bursts tell by their times whose it is.
    """
    n = evidence.structure.robot.n
    fast = excess = 0.0
    near, chance = np.zeros(n), np.zeros(n)
    for trajectory, residual in zip(evidence.trajectories, residual_beside_hidden_path(evidence), strict=True):
        measured = trajectory.measured
        if measured.base_frequency is None or measured.decimate != 1:
            return None
        r = residual[:, joint]
        high, lines = _fast_part(r, measured.base_frequency)
        excess += float(np.sum(r**2)) - float(trajectory.dof[joint])
        fast += float(np.sum(high**2)) - lines
        load = evidence.structure.torques(trajectory.motion, evidence.values).load
        for other in range(n):
            rows = _after_reversals(load[:, other], round(AFTER / measured.dt))
            share = float(rows.mean())
            near[other] += float(np.sum(high[rows] ** 2)) - lines * share
            chance[other] += share / len(evidence.trajectories)
    if excess <= 0.0 or fast <= SHARE_FAST * excess:
        return None
    beyond = near / fast - chance
    cause = int(np.argmax(beyond))
    return cause if near[cause] > max(SHARE_NEAR, chance[cause] + CHANCE) * fast else None


def _fast_part(residual: Array, frequency: float) -> tuple[Array, float]:
    """Return a residual [N] above FAST, and the energy that noise alone has there (in units of its variance)."""
    spectrum = np.fft.rfft(residual)
    spectrum[np.arange(len(spectrum)) * frequency < FAST] = 0.0
    return np.fft.irfft(spectrum, len(residual)), 2.0 * float(np.sum(spectrum != 0.0))


def _after_reversals(load: Array, reach: int) -> Mask:
    """Return the samples that follow a change of sign of the load within `reach`, or precede it by a tenth of that."""
    change = np.flatnonzero(np.sign(load) != np.sign(np.roll(load, 1)))
    rows = np.zeros(len(load), dtype=bool)
    for place in change:
        rows[np.arange(place - reach // 10, place + reach) % len(load)] = True
    return rows
