"""Low passes without phase, the same for torque and every regressor column; a mass on a spring that a force drives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.derivatives import finer, step
from robot_ident.signals.motion import Array, Motion

_MEMORY = 8.0  # periods of the cutoff: the filter's slowest mode falls to exp(-2 pi sin(pi / 16) 8) = 6e-5 in them


def there_and_back(frequency: NDArray[np.floating[Any]], cutoff: float) -> Array:
    """Return the gain of a Butterworth low pass of order 4 that runs forward and backward, 1 / (1 + (f / cutoff)^8)."""
    return np.asarray(1.0 / (1.0 + (frequency / cutoff) ** 8))


class LowPass(Protocol):
    """A linear filter along time."""

    @property
    def cutoff(self) -> float:
        """Hz."""

    @property
    def independent(self) -> float:
        """Share of the variance of white noise that passes."""

    def apply(self, x: Array) -> Array:
        """Return x [N, ...] filtered along its first axis."""


@dataclass(frozen=True)
class PeriodicLowPass:
    """Keeps the lines of a period up to `cutoff` [Hz] and nothing else: exact on a periodic signal."""

    cutoff: float
    frequency: float
    samples: int

    @property
    def lines(self) -> int:
        """Number of lines kept beside the mean."""
        return min(int(self.cutoff / self.frequency + 1e-9), (self.samples - 1) // 2)

    @property
    def gain(self) -> Array:
        """Gain [N // 2 + 1] of the lines of the period."""
        return np.asarray(np.arange(self.samples // 2 + 1) <= self.lines, dtype=float)

    @property
    def independent(self) -> float:
        """(2 K + 1) / N."""
        return (2 * self.lines + 1) / self.samples

    def apply(self, x: Array) -> Array:
        """Return x [N, ...] without its lines above the cutoff."""
        spectrum = np.fft.rfft(x, axis=0)
        spectrum[self.lines + 1 :] = 0.0
        return np.fft.irfft(spectrum, self.samples, axis=0)


@dataclass(frozen=True)
class SoftPeriodicLowPass:
    """Butterworth gain of order 4 there and back on the lines of a period, 1 / (1 + (f / cutoff)^8): forgets within
    1 / cutoff, so that what a rest hides does not reach far into the motion beside it.
    """

    cutoff: float
    frequency: float
    samples: int

    @property
    def gain(self) -> Array:
        """Gain [N // 2 + 1] of the lines of the period."""
        lines = np.arange(self.samples // 2 + 1) * self.frequency
        return there_and_back(lines, self.cutoff)

    @property
    def independent(self) -> float:
        """Variance of white noise after the filter, relative to before."""
        power = self.gain**2
        last = power[-1] if self.samples % 2 == 0 else 0.0
        return float((2.0 * power.sum() - power[0] - last) / self.samples)

    def apply(self, x: Array) -> Array:
        """Return x [N, ...], low-passed."""
        spectrum = np.fft.rfft(x, axis=0) * self.gain.reshape(-1, *([1] * (x.ndim - 1)))
        return np.fft.irfft(spectrum, self.samples, axis=0)


@dataclass(frozen=True)
class ZeroPhaseLowPass:
    """Butterworth gain of order 4 run forward and backward: 1 / (1 + (f / cutoff)^8), no phase, derivatives included.

    Works in the frequency domain on the signal extended by its odd reflection at both ends, as forward-backward
    filters do.
    """

    cutoff: float
    dt: float
    samples: int

    @cached_property
    def _pad(self) -> int:
        return min(self.samples - 1, int(_MEMORY / (self.cutoff * self.dt)) + 10)

    @cached_property
    def _size(self) -> int:
        from scipy.fft import next_fast_len

        return int(next_fast_len(self.samples + 2 * self._pad, real=True))

    @cached_property
    def _frequencies(self) -> Array:
        return np.asarray(np.fft.rfftfreq(self._size, self.dt))

    @cached_property
    def _gain(self) -> Array:
        return there_and_back(self._frequencies, self.cutoff)

    @property
    def independent(self) -> float:
        """Variance of white noise after the filter, relative to before."""
        return float(np.mean(self._gain**2))

    def apply(self, x: Array, derivative: int = 0) -> Array:
        """Return x [N, ...] or its time derivative, low-passed."""
        size, pad = self._size, self._pad
        head = 2.0 * x[0] - x[pad:0:-1]
        tail = 2.0 * x[-1] - x[-2 : -pad - 2 : -1]
        long = np.concatenate([head, x, tail])
        # less the line between its ends, which passes as it is: a spectrum takes the last value to lead to the first
        slope = (long[-1] - long[0]) / (len(long) - 1)
        line = long[0] + np.multiply.outer(np.arange(len(long)), slope)
        factor = self._gain * (2j * np.pi * self._frequencies) ** derivative
        spectrum = np.fft.rfft(long - line, size, axis=0) * factor.reshape(-1, *([1] * (x.ndim - 1)))
        kept = slice(pad, pad + self.samples)
        passed = {0: line[kept], 1: slope / self.dt}.get(derivative, 0.0)
        return np.asarray(np.fft.irfft(spectrum, size, axis=0)[kept] + passed)

    def noise_gain(self, derivative: int) -> float:
        """Return the noise of a derivative per unit noise of a sample, 1/s^derivative."""
        return float(np.sqrt(np.mean(self._gain**2 * (2.0 * np.pi * self._frequencies) ** (2 * derivative))))

    def smear(self) -> int:
        """Return how many samples to either side carry most of the filter's memory."""
        return int(0.5 / (self.cutoff * self.dt)) + 1


_SWING = 0.1  # rad of a free motion from one instant to the next: its frequency comes .1 % too low
_FINEST = 16  # instants a sample


def ringing(
    motion: Motion, force: Array, inertia: Array, damping: Array, stiffness: Array
) -> tuple[Array, Array, Array]:
    """Return what `driven` does for forces that are smooth between the samples: at as many instants as the free motion
    needs.
    """
    swing = float(np.sqrt(np.mean(stiffness) / np.mean(inertia))) * step(motion)
    factor = min(_FINEST, int(np.ceil(swing / _SWING)))
    if factor <= 1:
        return driven(motion, force, inertia, damping, stiffness)
    parts = finer(np.stack([force, inertia, damping, stiffness], axis=1), motion, factor)
    x, dx, ddx = _driven(step(motion) / factor, motion.periodic, *parts.T)
    return x[::factor], dx[::factor], ddx[::factor]


def driven(
    motion: Motion, force: Array, inertia: Array, damping: Array, stiffness: Array
) -> tuple[Array, Array, Array]:
    """Return x, dx/dt and d2x/dt2 [N] of m x'' + d x' + k x = f, all of them [N] along a motion of even samples.

    Over a period of a periodic motion the settled solution; elsewhere it begins at rest where the force holds it. By
    the rule of constant average acceleration, x between two samples averaged (Newmark 1959): stable for m, d >= 0 and k
    > 0, right to (2 pi f dt)^2 / 12 of the frequency f of its free motion.
    """
    return _driven(step(motion), motion.periodic, force, inertia, damping, stiffness)


def _driven(
    dt: float, periodic: bool, force: Array, inertia: Array, damping: Array, stiffness: Array
) -> tuple[Array, Array, Array]:
    samples = len(force)
    mean = (np.roll(force, 1) + 2.0 * force + np.roll(force, -1)) / 4.0
    mass, drag, spring = inertia / dt**2, damping / (2.0 * dt), stiffness / 4.0
    if not periodic:
        mean[0], mean[-1] = force[0], force[-1]
    # row i: (m - d + k) x[i-1] + 2 (k - m) x[i] + (m + d + k) x[i+1] = mean[i], from x[-1] and x[0]
    band = np.ones((3, samples + 2))
    band[0, 2:], band[1, 1:-1], band[2, :-2] = mass + drag + spring, 2.0 * (spring - mass), mass - drag + spring
    band[1, 0] = 0.0
    right = np.zeros((samples + 2, 3))
    right[2:, 0] = mean
    right[0, 1] = right[1, 2] = 1.0
    if not periodic:
        right[:2, 0] = force[0] / stiffness[0]
        x = _forward(band, right[:, 0])
    else:
        settled, first, second = _forward(band, right).T
        back = np.array([[first[-2], second[-2]], [first[-1], second[-1]]])  # what starts are after a period
        start = np.linalg.solve(np.eye(2) - back, settled[-2:])
        x = settled + first * start[0] + second * start[1]
    before, here, after = x[:-2], x[1:-1], x[2:]
    return here, (after - before) / (2.0 * dt), (after - 2.0 * here + before) / dt**2


def _forward(band: Array, right: Array) -> Array:
    """Return x [N, ...] of a lower triangular system of three diagonals [3, N], row by row."""
    from scipy.linalg.lapack import dtbtrs

    return np.asarray(dtbtrs(band, right, uplo="L")[0])
