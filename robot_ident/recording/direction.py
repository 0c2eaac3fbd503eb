"""Where the direction of motion is certain although a drive may stick or give way as it reverses."""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array, Mask, Motion

_KINK = 9.0  # (|c_k| / its noise)^2 below which a Fourier line may hide among noise


def direction_known(motion: Motion, lines: Mask, variance: Array, frequency: float, dt: float) -> Mask:
    """Return the rows [N, n] where kinks of the path that noise hides can't have turned the direction of motion.

    lines [K + 1, n]: Fourier lines of the positions that stand above white noise of `variance` [n] rad^2 a row, at
    multiples of `frequency` [Hz]; dt: between rows [s]. A drive that sticks or gives way as it reverses bends its
    velocity at once. Lines of such a kink fall with the third power of frequency, so that those beyond the last one
    above the noise (at f_c, of amplitude c) add up to a velocity of 2 pi c f_c^2 / f_0 beside the reversal. No more is
    given up than the motion usually gains within a sample.
    """
    amplitude = np.sqrt(_KINK * 4.0 * variance / len(motion.q))
    hidden = 2.0 * np.pi * amplitude * lines.sum(axis=0) ** 2 * frequency
    usual = np.sqrt(np.mean(motion.ddq**2, axis=0)) * dt
    return np.asarray(np.abs(motion.dq) >= np.minimum(hidden, usual))
