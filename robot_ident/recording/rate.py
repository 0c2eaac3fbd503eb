"""Is a recording sampled fast enough for its motion? Judged by the acceleration beyond what sampling leaves usable."""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array

_SHARE = 0.02  # of the acceleration's power that may lie above the part of the band that sampling leaves usable
_TOP = 0.2  # of the sample rate: the low pass of what does not repeat lies there
_ARM = 20.0  # Hz: no arm accelerates faster on purpose
_FLOOR = 0.2  # share of the lines above it whose power is taken for noise and aliases
_COARSE = 2e-3  # of a joint's range: noise that no encoder has, so that it is motion folded back
_LEAST = 64  # samples
_NEIGHBOURS = 9  # lines that are averaged; with fewer up there, nearly all of the band is usable


def fast_share(q: Array, dt: float) -> Array:
    """Return the share [n] of each joint's acceleration power above a fifth of the sample rate (to 20 Hz), noise taken
    out.

    Power of a line: (2 pi f)^4 |q(f)|^2, less a white floor, the level of the weakest fifth of the lines up there. A
    floor beyond any encoder's noise is motion folded back and counts as 1.
    """
    n = q.shape[1]
    if len(q) < _LEAST or _TOP / dt >= _ARM:
        return np.zeros(n)
    window = np.hanning(len(q))[:, None]
    ramp = np.linspace(0.0, 1.0, len(q))[:, None]
    rest = q - (q[0] + ramp * (q[-1] - q[0]))
    frequency = np.fft.rfftfreq(len(q), dt)
    power = np.abs(np.fft.rfft((rest - rest.mean(axis=0)) * window, axis=0)) ** 2
    power = _smoothed(power)
    top = (frequency >= _TOP / dt) & (frequency <= _ARM)
    if top.sum() < _NEIGHBOURS:
        return np.zeros(n)
    floor = np.quantile(power[top], _FLOOR, axis=0)
    above = (2.0 * np.pi * frequency[:, None]) ** 4 * np.maximum(power - 3.0 * floor, 0.0)
    above[frequency > _ARM] = 0.0
    total = above.sum(axis=0)
    share = above[top].sum(axis=0) / np.where(total > 0.0, total, 1.0)
    noise = np.sqrt(np.maximum(floor, 0.0) / np.sum(window**2))
    reach = np.ptp(q, axis=0)
    return np.where((reach > 1e-6) & (noise > _COARSE * reach), 1.0, share)


def rate_note(q: Array, dt: float, joints: tuple[str, ...]) -> str:
    """Return a line that names the joints which move faster than the samples of q [N, n] can follow; empty if none."""
    share = fast_share(q, dt)
    slow = [name for name, part in zip(joints, share, strict=True) if part > _SHARE]
    if not slow:
        return ""
    return (
        f"{1.0 / dt:.4g} Hz is too low a rate for the motion of {', '.join(slow)}: their acceleration changes"
        " between samples, so that inertia is seen blurred; record faster, or move more gently"
    )


def _smoothed(power: Array) -> Array:
    """Return a spectrum [K, n] averaged over neighbours, so that single lines of noise don't count as motion."""
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(power, _NEIGHBOURS, axis=0, mode="nearest"))
