"""Derivatives and shifts of signals along the time of a motion: exact over a period, by differences otherwise."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.motion import Array, Motion


def derivatives(x: Array, motion: Motion) -> tuple[Array, Array]:
    """Return dx/dt and d2x/dt2 of x [N, ...] along a motion with even samples.

    Over a period of a periodic motion by its Fourier series, which is exact for lines below the Nyquist frequency;
    otherwise by central differences.
    """
    dt = step(motion)
    if not motion.periodic:
        first = np.gradient(x, dt, axis=0, edge_order=2)
        return first, np.gradient(first, dt, axis=0, edge_order=2)
    samples = len(x)
    w = 2j * np.pi * np.fft.rfftfreq(samples, dt).reshape(-1, *(1,) * (x.ndim - 1))
    lines = np.fft.rfft(x, axis=0)
    odd = lines.copy()
    if samples % 2 == 0:
        odd[-1] = 0.0  # the Nyquist line has no odd derivative
    return np.fft.irfft(w * odd, samples, axis=0), np.fft.irfft(w**2 * lines, samples, axis=0)


def delayed(x: Array, motion: Motion, delay: float) -> Array:
    """Return x(t - delay) for x [N, ...]; beyond the ends of a motion that isn't periodic x keeps its last value.

    Piecewise cubic Hermite interpolation (Fritsch and Butland 1984): it follows smooth parts closely, and beside steps
    of dry friction it does not ring, as a shift of the Fourier series does.
    """
    samples = len(x)
    at = np.arange(samples) - delay / step(motion)
    at = np.mod(at, samples) if motion.periodic else np.clip(at, 0.0, samples - 1.0)
    left = np.minimum(at.astype(int), samples - 1)
    right = (left + 1) % samples if motion.periodic else np.minimum(left + 1, samples - 1)
    u = (at - left).reshape(-1, *(1,) * (x.ndim - 1))
    slope = _monotone_slopes(x, motion.periodic)
    rise = x[right] - x[left]
    bend = u * (1 - u) * ((1 - u) * (slope[left] - rise) - u * (slope[right] - rise))
    return np.asarray(x[left] + u * rise + bend)


def finer(x: Array, motion: Motion, factor: int) -> Array:
    """Return x [N, ...] at `factor` instants for every sample of a motion: by its Fourier series over a period, by a
    cubic spline elsewhere, from the first sample to the last.
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import resample

    if motion.periodic:
        return np.asarray(resample(x, factor * len(x)))
    return np.asarray(CubicSpline(np.arange(len(x)), x)(np.arange(factor * (len(x) - 1) + 1) / factor))


def lagged(x: Array, motion: Motion, span: float) -> Array:
    """Return x [N, ...] behind a first-order lag of time constant span [s]: span dy/dt = x - y.

    Exact at samples joined by straight lines; settled on a period, or, elsewhere, on the first sample.
    """
    from scipy.signal import lfilter

    ratio = step(motion) / span
    kept = float(np.exp(-ratio))
    early = (1.0 - kept) / ratio - kept  # of the sample before, and of this one: a straight line's response
    b, a = [1.0 - (1.0 - kept) / ratio, early], [1.0, -kept]
    whole = np.concatenate([x, x]) if motion.periodic else x
    start = np.asarray(early * whole[:1] + kept * whole[:1])
    return np.asarray(lfilter(b, a, whole, axis=0, zi=start)[0][-len(x) :])


def _monotone_slopes(x: Array, periodic: bool) -> Array:
    """Return slopes per sample [N, ...]: harmonic means of the neighbouring rises, zero at extremes."""
    rise = np.roll(x, -1, axis=0) - x
    if not periodic:
        rise[-1] = rise[-2] if len(x) > 1 else 0.0
    before = np.roll(rise, 1, axis=0)
    if not periodic:
        before[0] = rise[0]
    product = before * rise
    total = np.where(product > 0, before + rise, 1.0)
    return np.asarray(np.where(product > 0, 2 * product / total, 0.0))


def step(motion: Motion) -> float:
    """Return the time between samples [s]; ValueError where they don't follow each other evenly."""
    if motion.dt is None:
        raise ValueError("a motion with even samples was expected")
    return motion.dt
