"""The residual's power in bands of frequency, in units of the noise that each line has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.evidence import Evidence, Trajectory
from robot_ident.motion import Array


@dataclass(frozen=True)
class Band:
    """Lines from `lower` up to `upper` [Hz]: their squared error in units of the noise, and its degrees of freedom."""

    lower: float
    upper: float
    power: float
    dof: float


def bands(evidence: Evidence, joint: int, edges: Sequence[float]) -> list[Band]:
    """Return the bands between edges [Hz] of a joint, all trajectories together; none where one isn't periodic."""
    power, dof = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
    for t, residual in zip(evidence.trajectories, evidence.residual, strict=True):
        frequency = t.measured.base_frequency
        if frequency is None or t.measured.decimate != 1:
            return []
        square, count = _lines(t, residual[:, joint], joint)
        rate = np.arange(len(square)) * frequency
        place = np.searchsorted(edges, rate, side="right") - 1
        inside = (place >= 0) & (place < len(power))
        np.add.at(power, place[inside], square[inside])
        np.add.at(dof, place[inside], count[inside])
    return [
        Band(float(a), float(b), float(p), float(d))
        for a, b, p, d in zip(edges[:-1], edges[1:], power, dof, strict=True)
        if d > 0
    ]


def effective_share(t: Trajectory, joint: int) -> float:
    """Return the factor by which coloured noise of density S lowers the degrees of freedom of a squared error.

    (mean S)^2 / mean S^2.
    """
    density = _density(t, joint)
    if density is None:
        return 1.0
    density = density[density > 0]
    return float(np.mean(density) ** 2 / np.mean(density**2))


def _lines(t: Trajectory, residual: Array, joint: int) -> tuple[Array, Array]:
    """Return the squared error of every line in units of its own noise, and its degrees of freedom."""
    samples = len(residual)
    spectrum = np.abs(np.fft.rfft(residual)) ** 2 * (2.0 / samples)
    count = np.full(len(spectrum), 2.0)
    ends = [0, -1] if samples % 2 == 0 else [0]
    spectrum[ends] *= 0.5
    count[ends] = 1.0
    filtered = t.measured.low_pass
    if filtered is not None and t.measured.base_frequency is not None:
        count[np.arange(len(count)) * t.measured.base_frequency > filtered.cutoff + 1e-9] = 0.0
    # rows that don't count are zero: they take their share of every line's noise with them
    count = count * float(np.mean(t.weight[:, joint] > 0))
    density = _density(t, joint)
    if density is not None:
        shape = density / np.mean(density[density > 0])
        count = np.where(shape > 0, count, 0.0)
        spectrum = spectrum / np.where(shape > 0, shape, 1.0)
    return np.where(count > 0, spectrum, 0.0), count


def _density(t: Trajectory, joint: int) -> Array | None:
    """Return the density of the noise over the lines of the period; None where it is white or not known."""
    noise = t.measured.noise
    if noise is None or not noise.coloured[joint] or len(noise.density) != len(t.y) // 2 + 1:
        return None
    return np.real(noise.density[:, joint, joint])
