"""Noise without a model: its spectrum from the scatter of the periods about their mean, across joints.

The scatter also tells how far samples are off their clock: all joints are off along their speeds at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.motion import Array

Density = NDArray[np.complex128]  # [K + 1, n, n]

_LINES = 60  # spectral lines that are smoothed together
_BANDS = 24  # of the test for colour
_ORDER = 24  # of the autoregression that is a first guess of a coloured spectrum
_AT_ONCE = 4_000_000  # values of periods that are transformed together
_ALPHA = 1e-5  # false alarms of the tests for colour and for correlation between joints
_MATERIAL = 0.1  # a deviation from white below this share changes no standard deviation by 5 %


@dataclass(frozen=True)
class NoiseSpectrum:
    """Cross-spectral density of the torque noise of one sample.

    density [K + 1, n, n] (Nm)^2, Hermitian: its mean over all two-sided lines of a period is the covariance of a sample
    where the recording was not low-passed. samples: of the period's grid. dof: degrees of freedom of a smoothed line.
    coloured [n]: whether a joint's spectrum differs from white, correlated: whether joints share noise (tests at 1e-5).
    variance [n]: mean over the lines that are used, before any smoothing, with variance_dof degrees of freedom.
    """

    density: Density
    samples: int
    dof: float
    coloured: tuple[bool, ...]
    correlated: bool
    variance: Array
    variance_dof: float

    @property
    def white(self) -> bool:
        """Whether every joint's noise is white and independent of the others'."""
        return not (self.correlated or any(self.coloured))

    @property
    def power(self) -> Array:
        """The density [K + 1, n] (Nm)^2 of each joint by itself."""
        return _diagonal(self.density)

    def autocovariance(self) -> Array:
        """Return E[n_i(t) n_j(t + lag)] of one sample's noise [samples, n, n] (Nm)^2, circular in the lag."""
        return np.asarray(np.fft.irfft(self.density, self.samples, axis=0))

    def covariance(self) -> Array:
        """Return the covariance of one sample across joints [n, n] (Nm)^2."""
        return self.autocovariance()[0]

    def passed_variance(self, gain: Array) -> Array:
        """Return the variance [n] of one sample's noise behind a low pass with a gain [K + 1] at the period's lines."""
        power = self.power * (gain**2)[:, None]
        last = power[-1] if self.samples % 2 == 0 else 0.0
        return np.asarray((2.0 * power.sum(axis=0) - power[0] - last) / self.samples)

    def with_floor(self, least: Array) -> NoiseSpectrum:
        """Return the spectrum with joints of less variance than `least` [n] at that, white and alone: what scatters
        there is rounding, which says nothing of noise.
        """
        silent = self.variance < least
        if not silent.any():
            return self
        density = self.density.copy()
        density[:, silent, :] = 0.0
        density[:, :, silent] = 0.0
        for joint in np.flatnonzero(silent):
            density[:, joint, joint] = least[joint]
        return replace(
            self,
            density=density,
            coloured=tuple(bool(c and not s) for c, s in zip(self.coloured, silent, strict=True)),
            correlated=self.correlated and int(np.sum(~silent)) > 1,
            variance=np.maximum(self.variance, least),
        )

    def multiply(self, x: Array) -> Array:
        """Return S x for signals x [N, n, p] over a whole period: each line times its density."""
        spectrum = np.fft.rfft(x, axis=0)
        return np.fft.irfft(np.einsum("kij,kjp->kip", self.density.conj(), spectrum), self.samples, axis=0)


def _diagonal(density: Density) -> Array:
    return np.real(np.einsum("kii->ki", density))


def mean_of_periods(periods: Array) -> Array:
    """Return the mean [N, n] of periods [M, N, n] (gaps nan), nan where none has a sample; joint by joint, since there
    may be many.
    """
    mean = np.full(periods.shape[1:], np.nan)
    for joint in range(periods.shape[2]):
        present = np.isfinite(periods[:, :, joint]).sum(axis=0)
        np.divide(np.nansum(periods[:, :, joint], axis=0), present, out=mean[:, joint], where=present > 0)
    return mean


def noise_spectrum(
    periods: Array,
    variance: Array | None = None,
    *,
    lines: int | None = None,
    response: NDArray[np.complex128] | None = None,
    grid: int | None = None,
) -> NoiseSpectrum:
    """Return the spectrum of the scatter of periods [M, N, n] about their mean; gaps are nan.

    S_ij(k) = sum_m conj(R_mi(k)) R_mj(k) / (N (M - 1)), smoothed over 60 lines; scaled to the variance [n] of a sample
    where that is given. lines: how many of the averaged torque are used; response [N / 2 + 1, n]: what the periods are
    divided by; grid: samples of the averaged period where it is finer.
    """
    count, samples, n = periods.shape
    cross = _cross_spectra(periods)
    if response is not None:
        used = response[: len(cross)]
        cross = cross / (used.conj()[:, :, None] * used[:, None, :])
    last = (samples - 1) // 2 if lines is None else min(lines, (samples - 1) // 2)
    inner = cross[1 : last + 1]
    coloured = tuple(_is_coloured(np.real(inner[:, j, j]), count - 1) for j in range(n))
    correlated = n > 1 and _is_correlated(inner, count - 1)
    power = _diagonal(cross)
    found = (power[0] + 2.0 * power[1 : last + 1].sum(axis=0)) / (2 * last + 1)
    width = min(_LINES, len(inner))
    first = [
        _autoregressive(one, count - 1) if colour else np.ones(last)
        for one, colour in zip(power[: last + 1].T, coloured, strict=True)
    ]
    smooth = _shaped(_smoothed(inner, np.column_stack(first), width), coloured, correlated)
    smooth = _scaled(smooth, found if variance is None else variance)
    grid = grid or samples
    density = np.zeros((grid // 2 + 1, n, n), dtype=complex)
    density[1 : last + 1] = smooth
    density[0] = np.real(smooth[0])
    if lines is None:
        density[last + 1 :] = np.real(smooth[-1])
    dof = 2.0 * width * (count - 1)
    return NoiseSpectrum(density, grid, dof, coloured, correlated, found, float((2 * last + 1) * (count - 1)))


def _cross_spectra(periods: Array) -> Density:
    count, samples, n = periods.shape
    mean = mean_of_periods(periods)
    cross: Density = np.zeros((samples // 2 + 1, n, n), dtype=complex)
    present = 0
    for block in np.array_split(np.arange(count), max(1, periods.size // _AT_ONCE)):
        rest = periods[block[0] : block[-1] + 1] - mean
        there = np.isfinite(rest)
        r = np.fft.rfft(np.where(there, rest, 0.0), axis=1)
        cross += np.einsum("mki,mkj->kij", r.conj(), r)
        present += int(there.sum())
    return cross / (samples * (count - 1) * (present / periods.size))


def _smoothed(x: Density, shape: Array, width: int) -> Density:
    """Return x [K, n, n] smoothed over `width` lines, after division by a first guess of each joint's shape [K, n]: a
    window as wide as a resonance would flatten it.
    """
    from scipy.ndimage import uniform_filter1d

    size = np.sqrt(shape[:, :, None] * shape[:, None, :])
    real = uniform_filter1d(np.real(x) / size, width, axis=0, mode="reflect")
    imaginary = uniform_filter1d(np.imag(x) / size, width, axis=0, mode="reflect")
    return np.asarray((real + 1j * imaginary) * size)


def _autoregressive(power: Array, repeats: int) -> Array:
    """Return the density of the autoregression that a spectrum [K + 1] suggests, on lines 1 to K.

    Levinson and Durbin's recursion on the autocovariance of the lines; the order by Schwarz's criterion.
    """
    last = len(power) - 1
    size = 2 * last + 1
    covariance = np.fft.irfft(power, size)
    best, coefficients = np.inf, np.ones(1)
    a, error = np.ones(1), float(covariance[0])
    for order in range(1, min(_ORDER, last // 4) + 1):
        reflection = -float(a @ covariance[order:0:-1]) / error
        a = np.append(a, 0.0) + reflection * np.append(a, 0.0)[::-1]
        error *= 1.0 - reflection**2
        if error <= 0.0:
            break
        criterion = size * repeats * np.log(error) + order * np.log(size * repeats)
        if criterion < best:
            best, coefficients = criterion, a
    response = np.fft.rfft(coefficients, size)[1:] if len(coefficients) <= size else np.ones(last)
    return np.asarray(1.0 / np.abs(response) ** 2)


def _shaped(smooth: Density, coloured: tuple[bool, ...], correlated: bool) -> Density:
    """Return the density with what the tests did not find taken out: white joints flat, independent ones apart."""
    n = smooth.shape[1]
    if not correlated:
        smooth = smooth * np.eye(n)
        for joint in range(n):
            if not coloured[joint]:
                smooth[:, joint, joint] = np.mean(smooth[:, joint, joint])
    elif not any(coloured):
        smooth = np.broadcast_to(np.real(smooth.mean(axis=0)), smooth.shape)
    return smooth


def _scaled(smooth: Density, variance: Array) -> Density:
    power = _diagonal(smooth).mean(axis=0)
    scale = np.sqrt(variance / np.where(power > 0, power, 1.0))
    return np.asarray(smooth * scale[:, None] * scale[None, :])


def _bands(lines: int) -> list[np.ndarray]:
    return np.array_split(np.arange(lines), max(1, min(_BANDS, lines // 8)))


def _is_coloured(power: Array, repeats: int) -> bool:
    """Bartlett's test: do bands of lines [K] have one variance?"""
    from scipy.special import chdtrc

    bands = _bands(len(power))
    if len(bands) < 2 or not np.all(power > 0):
        return False
    dof = np.array([2.0 * repeats * len(band) for band in bands])
    mean = np.array([power[band].mean() for band in bands])
    total = float(np.sum(dof * mean) / dof.sum())
    if np.abs(mean / total - 1.0).max() < _MATERIAL:
        return False
    statistic = float(dof.sum() * np.log(total) - np.sum(dof * np.log(mean)))
    correction = 1.0 + (np.sum(1.0 / dof) - 1.0 / dof.sum()) / (3.0 * (len(bands) - 1))
    return bool(chdtrc(len(bands) - 1, statistic / correction) < _ALPHA)


def _is_correlated(cross: Density, repeats: int) -> bool:
    """Test the coherence of every pair of joints, band by band: P(coherence^2 > x) = (1 - x)^(nu - 1) for none."""
    n = cross.shape[1]
    bands = _bands(len(cross))
    tests = len(bands) * n * (n - 1) // 2
    for band in bands:
        mean = cross[band].mean(axis=0)
        power = np.real(np.diag(mean))
        if not np.all(power > 0):
            continue
        coherence = np.abs(mean) ** 2 / np.outer(power, power)
        strongest = float(np.max(coherence[np.triu_indices(n, 1)]))
        freedom = repeats * len(band)
        if strongest > _MATERIAL**2 and (1.0 - min(strongest, 1.0)) ** (freedom - 1) < _ALPHA / tests:
            return True
    return False


@dataclass(frozen=True)
class OffClock:
    """By how much the instants of samples scatter about their stamps [samples, rms], and how many standard deviations
    the evidence is from none.
    """

    size: float
    sigmas: float


def off_clock(q: Array) -> OffClock | None:
    """Return the scatter of instants from periods of positions q [M, N, n], gaps nan; None for a single joint.

    A sample late by e moves joint i by dq_i e, so that r_i r_j has mean dq_i dq_j s^2 for every pair of joints, while
    noise of their own leaves it at 0. Differences of neighbouring samples are taken: what drifts slowly, a path that
    doesn't repeat for one, drops out. The spread between periods tells the uncertainty.
    """
    periods, _, joints = q.shape
    if joints < 2 or periods < 4:
        return None
    mean = mean_of_periods(q)
    speed = (np.roll(mean, -1, axis=0) - np.roll(mean, 1, axis=0)) / 2.0
    rate = (speed[1:] + speed[:-1]) / 2.0
    rest = [np.nan_to_num(np.diff(q[:, :, j] - mean[:, j], axis=1)) for j in range(joints)]
    # of a sample: a difference has twice its variance
    scale = np.array([np.sqrt(np.mean(one**2) / 2.0) for one in rest])
    if not np.all(scale > 0.0):
        return None
    rate /= scale  # joints with little noise tell most
    weight, found = 0.0, np.zeros(periods)
    for i in range(joints):
        for j in range(i):
            both = rate[:, i] * rate[:, j]
            found += np.einsum("mk,mk,k->m", rest[i], rest[j], both / (2.0 * scale[i] * scale[j]))
            weight += float(both @ both)
    if weight <= 0.0:
        return None
    variance = found / weight * periods / (periods - 1)  # the mean has taken its share of the scatter
    spread = float(np.std(variance, ddof=1) / np.sqrt(periods))
    centre = float(variance.mean())
    return OffClock(float(np.sqrt(max(centre, 0.0))), centre / spread if spread > 0.0 else 0.0)
