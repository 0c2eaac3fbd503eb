"""Rows around reversals that motion below the noise of the positions spoils.

A joint that turns back sticks and starts again within milliseconds: its acceleration jumps. Lines of that kink fall
with the third power of frequency, so that those beyond the last line above the noise are missing from the measured
path, whose acceleration is wrong within half a period of that line. A small error of that time looks like a delay.
Where it moves a torque by more than its noise, rows say nothing of how late an effort is or of what else is left.
"""

from __future__ import annotations

import numpy as np

from robot_ident.recording.measurement import Measurement
from robot_ident.signals.fourier import least_above_noise
from robot_ident.signals.motion import Array, Mask


def resolution(measured: Measurement) -> tuple[Array, Array]:
    """Return the time [n] s within which a kink of each joint's path is not resolved, 1 / (2 f), and the largest jump
    of acceleration [n] rad/s^2 that noise can hide there, 4 pi^3 c f^3 / f0.

    f: the fastest line of the mean period that stands above its noise; c: the amplitude from which on a line does; f0:
    one over the period. A jump of a has lines a / (pi k (2 pi k f0)^2). Of one pass, f is the corner of its low pass,
    and a sample more: steps of friction fall between two of them; how large its kinks are is not known (0).
    """
    n, variance, lines = measured.motion.joints, measured.averaged_position_variance, measured.position_lines
    if lines is None or variance is None or measured.base_frequency is None:
        passed = 0.0 if measured.low_pass is None else 0.5 / measured.low_pass.cutoff
        return np.full(n, passed + measured.dt), np.zeros(n)
    number = np.maximum([int(np.flatnonzero(lines[:, j]).max(initial=1)) for j in range(n)], 1)
    fastest = number * measured.base_frequency
    amplitude = least_above_noise(len(lines), variance, measured.motion.samples)
    return 0.5 / fastest, 4.0 * np.pi**3 * amplitude * fastest**3 / measured.base_frequency


def unresolved_rows(measured: Measurement, inertia: Array, sigma: Array) -> Mask:
    """Return the rows [N, n] that reversals spoil: within a joint's resolution of its reversal its acceleration may be
    off by as much as it is or as noise can hide, which moves joint j's torque by |M_jk| times that; and its velocity by
    as much over that time, which may turn its own dry friction.

    inertia: M [N, n, n] kg m^2 along the motion; sigma [n] Nm: noise of a row.
    """
    motion = measured.motion
    near, (within, hidden) = near_reversals(measured), resolution(measured)
    out = np.zeros_like(near)
    for k in range(motion.joints):
        rows = near[:, k]
        if rows.any():
            jump = np.minimum(np.abs(motion.ddq[rows, k, None]), hidden[k])
            out[rows] |= np.abs(inertia[rows, :, k]) * jump > sigma
            out[rows, k] |= np.abs(motion.dq[rows, k]) < jump[:, 0] * within[k]
    return out


def near_reversals(measured: Measurement) -> Mask:
    """Return the rows [N, n] within a joint's resolution of its reversals."""
    motion, (within, _) = measured.motion, resolution(measured)
    out = np.zeros(motion.dq.shape, dtype=bool)
    rows = np.arange(motion.samples)
    dt = measured.dt
    for joint in range(motion.joints):
        sign = np.sign(motion.dq[:, joint])
        turns = np.flatnonzero(sign != np.roll(sign, 1)) if motion.periodic else 1 + np.flatnonzero(np.diff(sign))
        if not len(turns):
            continue
        after = np.searchsorted(turns, rows)
        last, following = turns[after - 1], turns[after % len(turns)]
        apart = np.minimum(np.abs(rows - last), np.abs(following - rows))
        if motion.periodic:
            apart = np.minimum.reduce([apart, (rows - last) % motion.samples, (following - rows) % motion.samples])
        out[:, joint] = apart * dt <= within[joint]
    return out
