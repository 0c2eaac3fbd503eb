"""Fourier lines of a periodic signal: x(t) = sum_k Re(c_k exp(i k w t)), and its derivatives analytically."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_ident.motion import Array

Lines = NDArray[np.complex128]  # [K + 1, n]; line 0 is the mean, line k the amplitude of exp(i k w t)

_FALSE_LINE = 1e-6  # expected noise lines that pass as signal, per joint: one at 70 Hz would be 2 rad/s^2 of a KUKA


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
