"""Fourier lines of a periodic signal: x(t) = sum_k Re(c_k exp(i k w t)), and its derivatives analytically."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.motion import Array, Mask

Lines = NDArray[np.complex128]  # [K + 1, n]; line 0 is the mean, line k the amplitude of exp(i k w t)

_FALSE_LINE = 1e-6  # expected noise lines that pass as signal, per joint: one at 70 Hz would be 2 rad/s^2 of a KUKA
_BAND = 25  # lines that are judged together where none of them stands out
_FALSE_BAND = 1e-4  # chance that a joint's noise passes as one faint band or more
_FEWEST = 3  # faint lines in a band that tell its power


def lines_of_grid(x: Array) -> Lines:
    """Return the lines of one period on an even grid x [N, n]."""
    c: Lines = np.fft.rfft(x, axis=0) * (2.0 / len(x))
    c[0] *= 0.5
    if len(x) % 2 == 0:
        c[-1] *= 0.5
    return c


def fit_lines(t: Array, x: Array, frequency: float, count: int) -> Lines:
    """Return lines 0..count of x [N, n] at any times t [N] by least squares (gaps and uneven sampling allowed)."""
    width = 2 * count + 1
    normal, right = np.zeros((width, width)), np.zeros((width, x.shape[1]))
    for rows in np.array_split(np.arange(len(t)), max(1, len(t) * width // 4_000_000)):
        phase = 2.0 * np.pi * frequency * np.outer(t[rows], np.arange(1, count + 1))
        a = np.hstack([np.ones((len(rows), 1)), np.cos(phase), np.sin(phase)])
        normal += a.T @ a
        right += a.T @ x[rows]
    solution = np.linalg.solve(normal, right)
    c = np.zeros((count + 1, x.shape[1]), dtype=complex)
    c[0] = solution[0]
    c[1:] = solution[1 : count + 1] - 1j * solution[count + 1 :]
    return c


def evaluate(c: Lines, samples: int, frequency: float, derivative: int = 0) -> Array:
    """Return the signal or a derivative on `samples` even points of a period [samples, n]."""
    lines = np.arange(len(c))[:, None]
    full = np.zeros((samples // 2 + 1, c.shape[1]), dtype=complex)
    keep = min(len(full), len(c))
    full[:keep] = (c * (2j * np.pi * frequency * lines) ** derivative)[:keep]
    full[1:] *= 0.5
    if samples % 2 == 0:
        full[-1] *= 2.0 if derivative % 2 == 0 else 0.0
    return np.fft.irfft(full * samples, samples, axis=0)


def above_noise(c: Lines, variance: Array, samples: int) -> np.ndarray:
    """Return which lines [K + 1, n] stand above white noise of `variance` [n] per sample of the averaged period.

    |c_k|^2 N / (4 variance) is exponentially distributed for noise alone; the mean always counts.
    """
    keep = np.abs(c) > least_above_noise(len(c), variance, samples)
    keep[0] = True
    return np.asarray(keep)


def least_above_noise(count: int, variance: Array, samples: int) -> Array:
    """Return the amplitude [n] from which on one of `count` lines stands above white noise of `variance` [n]."""
    return np.asarray(np.sqrt(np.log(count / _FALSE_LINE) * 4.0 * np.maximum(variance, 1e-300) / samples))


def share_of_motion(c: Lines, strong: Mask, variance: Array, samples: int) -> Array:
    """Return which share [K + 1, n] of each measured line is motion rather than noise.

    A line that stands above the noise (`strong`) counts whole. Of the others, each too faint to be told from white
    noise of `variance` [n] per sample, a band may hold more power than noise: where its lines |c_k|^2 N / (4 variance)
    have the mean 1 + r, the share r / (1 + r) of each is the best linear estimate of the motion (Wiener 1949), and as
    much is left of the noise's variance. Bands are tested from the slow ones up, each at the same level, until one
    fails: the first that is noise ends the motion, so that no band is found by searching many, least of all a fast one,
    whose noise would be amplified by the square of its frequency.
    """
    from scipy.special import gammaincc

    share = strong.astype(float)
    power = np.abs(c) ** 2 * samples / (4.0 * np.maximum(variance, 1e-300))
    for joint in range(c.shape[1]):
        for first in range(1, (samples - 1) // 2 + 1, _BAND):
            band = np.arange(first, min(first + _BAND, len(c)))
            faint = band[~strong[band, joint]]
            if len(faint) < _FEWEST:
                continue
            total = float(power[faint, joint].sum())
            if gammaincc(len(faint), total) > _FALSE_BAND:
                break
            share[faint, joint] = 1.0 - len(faint) / total
    return share


def power_spectrum(x: Array) -> Array:
    """Return the power [K, n] of x [N, n] about its mean at every frequency, under a Hann window: of white noise of
    variance s^2 it is s^2.
    """
    window = np.hanning(len(x))[:, None]
    return np.asarray(np.abs(np.fft.rfft((x - x.mean(axis=0)) * window, axis=0)) ** 2 / np.sum(window**2))
