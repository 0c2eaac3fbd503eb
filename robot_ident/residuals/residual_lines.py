"""A residual line by line of frequency, beside the noise that each line has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.beside import Beside
from robot_ident.signals.filters import SoftPeriodicLowPass, ZeroPhaseLowPass, there_and_back
from robot_ident.signals.motion import Array, Mask

_SEGMENT = 10.0  # s: stretches over which the spectrum of a motion that doesn't repeat is averaged


@dataclass(frozen=True)
class ResidualLines:
    """Root mean square [K, n] Nm of a residual in every line at `frequency` [K] Hz; the mean and what a low pass takes
    away are no lines.

    noise [K, n] Nm: what noise alone leaves there on average, nan where unknown. excited [K]: lines that the motion
    itself holds, none where it does not repeat. width: Hz from line to line. mean [n] Nm: of the residual.
    """

    frequency: Array
    residual: Array
    noise: Array
    excited: Mask
    width: float
    mean: Array


def residual_lines(found: Beside, measured: Measurement) -> ResidualLines:
    """Return the Fourier lines of a period's residual, or averages over stretches of 10 s (Welch) where none repeats.

    A line's mean square is 2 |c|^2 / N^2 of the discrete transform c of N rows; that of white noise of variance v in a
    sample is 2 v dt times the width of a line.
    """
    rest = np.where(found.used, found.residual, 0.0)
    dt = measured.dt * measured.decimate
    periodic = measured.base_frequency is not None and measured.decimate == 1
    if periodic:
        frequency = np.arange(len(rest) // 2 + 1) / (len(rest) * dt)
        power = 2.0 * np.abs(np.fft.rfft(rest, axis=0) / len(rest)) ** 2
    else:
        frequency, power = _welch(rest, dt)
    excited: Mask = np.zeros(len(frequency), dtype=bool)
    if periodic and measured.position_lines is not None:
        held: Mask = np.asarray(measured.position_lines.any(axis=1))[: len(frequency)]
        excited[: len(held)] = held
    width = float(frequency[1])
    # rows that don't count are zero: they take their share of every line's noise with them
    noise = 2.0 * found.sigma**2 * found.used.mean(axis=0) * measured.dt * width * _shape(measured, frequency)
    keep = (frequency > 0.0) & (frequency <= (found.low_pass or np.inf) + 1e-9)
    mean = rest.sum(axis=0) / np.maximum(found.used.sum(axis=0), 1)
    return ResidualLines(
        frequency[keep], np.sqrt(power[keep]), np.sqrt(noise[keep]), excited[keep], width, np.asarray(mean)
    )


def _welch(rest: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies [K] Hz and the mean square [K, n] in a line of each, the width of a line being one over the
    length of a stretch.
    """
    from scipy.signal import welch

    size = min(len(rest), max(8, round(_SEGMENT / dt)))
    frequency, density = welch(rest, 1.0 / dt, nperseg=size, axis=0, detrend=False)
    return frequency, density * frequency[1]


def _shape(measured: Measurement, frequency: Array) -> Array:
    """Return the density [K, n] of the noise behind the low pass over frequency, where a sample's is 1 on average."""
    n = len(measured.joints)
    share = measured.low_pass.independent if measured.low_pass else 1.0
    shape = np.full((len(frequency), n), 1.0 / share)
    if isinstance(measured.low_pass, ZeroPhaseLowPass | SoftPeriodicLowPass):
        shape *= there_and_back(frequency[:, None], measured.low_pass.cutoff) ** 2
    told = measured.noise
    for joint in range(n):
        if told is not None and told.coloured[joint] and len(told.density) == len(frequency):
            density = np.real(told.density[:, joint, joint])
            shape[:, joint] *= density / max(float(np.mean(density[density > 0])), 1e-300)
    return shape
