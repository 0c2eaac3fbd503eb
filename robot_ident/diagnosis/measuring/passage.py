"""What may lie between a torque and its record: the low passes that drives have."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_ident.diagnosis.evidence import Trajectory
from robot_ident.signals.motion import Array

Response = NDArray[np.complex128]

HIGHEST = 0.45  # of the sample rate: the largest -3 dB frequency of a filter that is computed at it

_TWICE = np.sqrt(np.sqrt(2.0) - 1.0)  # of the -3 dB frequency in the corner of two equal lags, one behind the other
_MEAN = 0.442946  # -3 dB frequency of a mean over a second [Hz]: sinc(0.442946) = 1 / sqrt(2)


def _warped(f: Array, f0: float, rate: float) -> Array:
    """Return f / f0 as the bilinear transform bends it for a filter that is computed from sample to sample."""
    return np.asarray(np.tan(np.pi * np.minimum(f / rate, 0.4999)) / np.tan(np.pi * min(f0 / rate, HIGHEST)))


def _first(u: Array) -> Response:
    return np.asarray(1.0 / (1.0 + 1j * u))


def _second(u: Array) -> Response:
    return np.asarray(1.0 / (1.0 + 1j * np.sqrt(2.0) * u - u**2))


def _smoothed(f: Array, f0: float, rate: float) -> Response:
    """Return a / (1 - (1 - a) / z) of y_k = a x_k + (1 - a) y_(k-1)."""
    b = 1.0 - np.cos(2.0 * np.pi * min(f0 / rate, HIGHEST))
    a = np.sqrt(b * b + 2.0 * b) - b
    return np.asarray(a / (1.0 - (1.0 - a) * np.exp(-2j * np.pi * f / rate)))


def _averaged(f: Array, f0: float, rate: float) -> Response:
    u = _MEAN * f / f0
    return np.asarray(np.sinc(u) * np.exp(-1j * np.pi * u))


LOW_PASSES: Mapping[str, Callable[[Array, float, float], Response]] = {
    "first order": lambda f, f0, rate: _first(f / f0),
    "second-order Butterworth": lambda f, f0, rate: _second(f / f0),
    "two equal lags": lambda f, f0, rate: np.asarray(1.0 / (1.0 + 1j * _TWICE * f / f0) ** 2),
    "moving average": _averaged,
    "exponential smoothing of the samples": _smoothed,
    "first order from sample to sample": lambda f, f0, rate: _first(_warped(f, f0, rate)),
    "second-order Butterworth from sample to sample": lambda f, f0, rate: _second(_warped(f, f0, rate)),
}
"""Frequency responses H at f [K] Hz for a -3 dB frequency f0 [Hz] and a sample rate [Hz].

Of the drive, which computes far faster than it reports, and of a driver or a script that filters what is reported.
"""

ORDERS = {1: "first order", 2: "second-order Butterworth"}
"""Those that a robot YAML can declare, by their order."""


@dataclass(frozen=True)
class Passage:
    """A low pass: its form and its one parameter, the -3 dB frequency [Hz]."""

    form: str
    at: float

    def response(self, frequency: Array, rate: float) -> Response:
        """Return H at frequencies [K] Hz of what is sampled at a rate [Hz]."""
        return LOW_PASSES[self.form](frequency, self.at, rate)

    def applied(self, columns: Array, t: Trajectory) -> Array:
        """Return periodic columns [N, n, p] behind it, line by line."""
        samples, dt = len(columns), t.motion.dt or t.measured.dt
        frequency = np.asarray(np.fft.rfftfreq(samples, dt), dtype=float)
        lines = np.fft.rfft(columns, axis=0) * self.response(frequency, 1.0 / dt).reshape(-1, 1, 1)
        return np.fft.irfft(lines, samples, axis=0)

    def lag(self, rate: float) -> float:
        """Return how late [s] it passes what is slow: -d arg H / d omega at standstill."""
        slow = 1e-5 * rate
        return float(-np.angle(self.response(np.array([slow]), rate))[0] / (2.0 * np.pi * slow))

    def like(self, form: str, rate: float) -> Passage:
        """Return another low pass that is about as late."""
        if form == self.form:
            return self
        at = self.at * Passage(form, self.at).lag(rate) / self.lag(rate)
        return Passage(form, min(at, HIGHEST * rate))
