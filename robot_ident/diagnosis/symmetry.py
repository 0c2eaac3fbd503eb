"""What time reversal says of a residual: its odd part is dissipative, its even part conservative.

On a motion with q(t0 - t) = q(t0 + t) every position comes twice, with opposite velocities and the same acceleration.
Friction turns its sign between the two, gravity, springs and inertia don't.
"""

from __future__ import annotations

import numpy as np

from robot_ident.diagnosis.evidence import Trajectory
from robot_ident.signals.motion import Array

_TOLERANCE = 0.03  # of a joint's own rms: how far the mirrored motion may be off


def mirror(q: Array) -> np.ndarray | None:
    """Return the row that mirrors each row of a periodic motion q [N, n], or None where no instant mirrors it."""
    x = q - q.mean(axis=0)
    power = np.sum(x**2, axis=0)
    moving = power > 1e-9 * max(float(power.max()), 1e-300)
    spectrum = np.fft.rfft(x[:, moving], axis=0)
    # sum over s of q(s) q(m - s), for every m = 2 t0: |q - its mirror image|^2 = 2 (power - that)
    overlap = np.fft.irfft(spectrum**2, len(q), axis=0)
    off = np.max(np.sqrt(np.maximum(0.0, 2.0 * (1.0 - overlap / power[moving]))), axis=1)
    best = int(np.argmin(off))
    if off[best] > _TOLERANCE:
        return None
    return (best - np.arange(len(q))) % len(q)


def odd_and_even(t: Trajectory, residual: Array, joint: int) -> tuple[float, float] | None:
    """Return the excess squared error of the odd and the even part of a residual [N, n].

    None where the motion has no mirror.
    """
    if not t.motion.periodic or t.measured.decimate != 1:
        return None
    rows = mirror(t.motion.q)
    if rows is None:
        return None
    r = residual[:, joint]
    both = (t.weight[:, joint] > 0) & (t.weight[rows, joint] > 0)
    noise = float(t.dof[joint]) / max(1.0, float(np.sum(t.weight[:, joint] > 0)))
    parts = [np.sum((0.5 * (r + sign * r[rows])[both]) ** 2) - 0.5 * noise * both.sum() for sign in (-1.0, 1.0)]
    return max(0.0, float(parts[0])), max(0.0, float(parts[1]))
