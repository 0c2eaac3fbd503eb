"""The residual's lines in units of the noise that each of them has, whatever its colour, and its power in bands of
frequency.

A line of the position with variance s^2 gives the acceleration (2 pi f)^4 s^2, which the inertia M turns into torque.
It grows fast with frequency: of a stiff path known to many lines it is what is left over, and no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_ident.model.rigid_sensitivity import RigidSensitivity
from robot_ident.regression.evidence import Evidence, Trajectory, fitted, kept_between_parts
from robot_ident.signals.motion import Array, Mask

Values = NDArray[np.inexact[Any]]

_CHANCE = 2.5  # standard deviations by which a band must exceed its noise to count


@dataclass(frozen=True)
class Whitening:
    """Turns weighed rows [N, ...] of one joint and measurement into values with independent noise of variance 1.

    By Fourier's transform where rows are a whole period: rate [L] Hz of every line, shape [L]: its noise over the mean,
    1 where white. Without (rate None) the rows are left as they are. count [L]: degrees of freedom of each.
    known_dof: those of the noise's own estimate. scatter [L]: squares of the periods' scatter about their mean, as
    large as the noise of the rows, each line for itself; None where the noise is white or periods don't tell it.
    """

    count: Array
    shape: Array
    rate: Array | None
    known_dof: float
    scatter: Array | None = None

    @classmethod
    def of(cls, t: Trajectory, joint: int, used: Mask) -> Whitening:
        """Return the whitening of a trajectory's joint, of which the rows `used` [N] count."""
        measured = t.measured
        samples, whole = len(t.y), measured.variance_dof
        if measured.base_frequency is None or measured.decimate != 1:
            return cls(np.asarray(used * measured.independent, dtype=float), np.ones(samples), None, whole)
        rate = np.asarray(np.arange(samples // 2 + 1) * measured.base_frequency, dtype=float)
        count = np.where(np.arange(len(rate)) % (samples / 2) == 0, 1.0, 2.0)
        if measured.low_pass is not None:
            count[rate > measured.low_pass.cutoff + 1e-9] = 0.0
        density = _density(t, joint)
        if t.whitening is not None:
            return cls._of_whitened(t, joint, count * np.mean(used), rate)
        if density is None:
            return cls(count * np.mean(used), np.ones(len(rate)), rate, whole)
        count = np.where(density > 0.0, count, 0.0)
        shape = np.where(count > 0.0, density / (np.sum(count * density) / np.sum(count)), 1.0)
        plain = cls(count * np.mean(used), shape, rate, whole)
        return replace(plain, scatter=plain._scatter(measured.period_torque, joint))

    @classmethod
    def _of_whitened(cls, t: Trajectory, joint: int, count: Array, rate: Array) -> Whitening:
        """Return that of rows whose lines are in units of their noise already."""
        assert t.whitening is not None
        plain = cls(count, np.ones(len(rate)), rate, t.measured.variance_dof)
        density = _density(t, joint)
        scatter = None if density is None else plain._scatter(t.measured.period_torque, joint)
        if density is None or scatter is None:
            return plain
        power = t.whitening[:, joint] ** 2
        return replace(plain, scatter=scatter * power + count * (1.0 - relative_density(t, joint) * power))

    def _scatter(self, periods: Array | None, joint: int) -> Array | None:
        """Return the squares of the lines of periods [M, N, n] about their mean; gaps are nan."""
        if periods is None or periods.shape[1] != 2 * (len(self.shape) - 1) + periods.shape[1] % 2:
            return None
        rest = (periods[:, :, joint] - np.nanmean(periods[:, :, joint], axis=0)).T
        present = np.isfinite(rest)
        squares = np.sum(np.abs(self.lines(np.where(present, rest, 0.0), 0.0)) ** 2, axis=1)
        counted = float(np.sum(self.count))
        mean = float(np.sum(squares)) / counted if counted > 0.0 else 0.0
        return np.asarray(squares / mean) if mean > 0.0 and present.any() else None

    @property
    def coloured(self) -> bool:
        """Whether lines differ in their noise."""
        return bool(np.any(self.shape != 1.0))

    def lines(self, rows: Array, power: float = -0.5) -> Values:
        """Return rows [N, ...] as values whose squares add up to theirs, times `power` of the noise's shape.

        A line with a cosine and a sine counts as one complex value.
        """
        if self.rate is None:
            return rows
        end = np.where(np.arange(len(self.rate)) % (len(rows) / 2) == 0, 0.5, 1.0)
        factor = np.where(self.count > 0.0, np.sqrt(end * 2.0 / len(rows)) * self.shape**power, 0.0)
        return (np.fft.rfft(rows, axis=0).T * factor).T

    def inside(self, lower: float, upper: float) -> Mask:
        """Return which values lie from `lower` up to `upper` [Hz]; all of them where they are no lines."""
        if self.rate is None:
            return np.ones(len(self.count), dtype=bool)
        return np.asarray((self.rate >= lower) & (self.rate < upper))

    def noise_dof(self, inside: Mask) -> float:
        """Return the degrees of freedom of the noise's estimate over some of the lines."""
        return (
            self.known_dof * float(np.sum(self.count[inside]) / np.sum(self.count))
            if self.coloured or self.scatter is not None
            else self.known_dof
        )

    def noise(self, inside: Mask) -> float:
        """Return the square that noise makes of some of the whitened lines.

        Their number where the shape is known; where it is an estimate, smoothed over its neighbours, by the scatter of
        these very lines: an error of the shape then only weighs them a little otherwise.
        """
        if self.scatter is None:
            return float(np.sum(self.count[inside]))
        return float(np.sum(self.scatter[inside] / self.shape[inside]))


def relative_density(t: Trajectory, joint: int) -> Array:
    """Return the density of the torque's noise over the lines [K + 1] of the period, 1 on average and where it is not
    known.
    """
    density = _density(t, joint)
    if density is None:
        return np.ones(len(t.y) // 2 + 1)
    return np.where(density > 0.0, density / np.mean(density[density > 0.0]), 1.0)


def _density(t: Trajectory, joint: int) -> Array | None:
    """Return the density of the noise over the lines of the period; None where it is white or not known."""
    noise = t.measured.noise
    if noise is None or not noise.coloured[joint] or len(noise.density) != len(t.y) // 2 + 1:
        return None
    rounding = t.measured.quantisation
    floor = 0.0 if rounding is None else float(rounding[joint]) * t.measured.averages
    density = np.real(noise.density[:, joint, joint])
    return np.asarray(np.where(density > 0.0, density + floor, 0.0))


@dataclass(frozen=True)
class Whole:
    """One measurement's joint, put together from the parts of time into which the evidence may have cut it.

    places: of those parts among the trajectories. used [N]: rows that count. residual [N]: weighed.
    """

    places: tuple[int, ...]
    trajectory: Trajectory
    used: Mask
    residual: Array
    whitening: Whitening

    @property
    def spectral(self) -> bool:
        """Whether its values are lines."""
        return self.whitening.rate is not None

    def joined(self, columns: Sequence[Array], joint: int) -> Array:
        """Return columns [N, n, k] of each trajectory at a joint, [N, k] of the measurement."""
        return np.asarray(np.sum([columns[place][:, joint] for place in self.places], axis=0))


def wholes(evidence: Evidence, joint: int, residual: Sequence[Array] | None = None) -> list[Whole]:
    """Return the measurements of the evidence at a joint; residual [N, n] of each trajectory: the evidence's own."""
    residual = evidence.residual if residual is None else residual
    by_source: dict[int, list[int]] = {}
    for place, t in enumerate(evidence.trajectories):
        by_source.setdefault(id(t.measured), []).append(place)
    out = []
    for places in by_source.values():
        first = evidence.trajectories[places[0]]
        used = np.any([evidence.trajectories[k].weight[:, joint] > 0 for k in places], axis=0)
        joined = np.sum([residual[k][:, joint] for k in places], axis=0)
        out.append(Whole(tuple(places), first, used, joined, Whitening.of(first, joint, used)))
    return out


@dataclass(frozen=True)
class Band:
    """Lines from `lower` up to `upper` [Hz]: their squared error in units of the noise, and what of it noise makes.

    beyond: the difference, 0 where chance alone may have made it.
    """

    lower: float
    upper: float
    power: float
    noise: float
    beyond: float


def bands(evidence: Evidence, joint: int, edges: Sequence[float]) -> list[Band]:
    """Return the bands between edges [Hz] of a joint, all trajectories together; none where one isn't periodic."""
    parts = wholes(evidence, joint)
    if not all(part.spectral for part in parts):
        return []
    out = []
    for lower, upper in zip(edges[:-1], edges[1:], strict=True):
        power = noise = spread = 0.0
        for part in parts:
            w = part.whitening
            inside = w.inside(lower, upper)
            power += float(np.sum(np.abs(w.lines(part.residual, 0.0)[inside]) ** 2))
            level = w.count[inside] * w.shape[inside]
            noise += float(np.sum(level))
            spread += float(np.sum(2.0 * level * w.shape[inside]))
        if noise > 0.0:
            beyond = power - noise if power - noise > _CHANCE * np.sqrt(spread) else 0.0
            out.append(Band(float(lower), float(upper), power, noise, beyond))
    return out


_LEAST = 0.1  # of the noise's mean density: where a filter leaves less, a line is no better proof than one there
_MATTERS = 0.05  # of the torque's noise in a line: less from the positions' noise changes nothing


def whitened(evidence: Evidence) -> Evidence:
    """Return the evidence fitted again with every line in units of its own noise; itself where all are alike."""
    trajectories = white_lines(evidence.trajectories, evidence)
    if all(t.whitening is None for t in trajectories):
        return evidence
    return fitted(evidence.structure, trajectories, evidence.rigid, kept_between_parts(evidence))


def white_lines(trajectories: Sequence[Trajectory], evidence: Evidence) -> tuple[Trajectory, ...]:
    """Return trajectories with their lines in units of the noise, by the inertia that an evidence's model has."""
    return tuple(_white(t, evidence) for t in trajectories)


def inertia_along(t: Trajectory, evidence: Evidence) -> Array:
    """Return the torque [N, n, n] Nm of each joint that each one's acceleration of 1 rad/s^2 takes, along a motion."""
    structure, values = evidence.structure, evidence.values
    effects = [pair for pair in structure.placed if not pair[0].uses_torque]
    rigid = RigidSensitivity(structure.robot, structure.base, values[: len(structure.base.columns)], t.motion)
    out = rigid.inertia * structure.scales[:, None]
    plain = [structure.columns_of(effect, t.motion) @ values[own] for effect, own in effects]
    for joint in range(t.motion.joints):
        ddq = t.motion.ddq.copy()
        ddq[:, joint] += 1.0
        for (effect, own), before in zip(effects, plain, strict=True):
            out[:, :, joint] += structure.columns_of(effect, replace(t.motion, ddq=ddq)) @ values[own] - before
    return out


def _white(t: Trajectory, evidence: Evidence) -> Trajectory:
    measured = t.measured
    if measured.base_frequency is None or measured.decimate != 1 or measured.low_pass is not None:
        return t
    noise = np.column_stack([np.maximum(relative_density(t, joint), _LEAST) for joint in range(t.motion.joints)])
    path = _of_the_path(t, evidence)
    if np.max(path) >= _MATTERS:
        noise = noise + path
    return t if np.all(noise == 1.0) else t.whitened_by(1.0 / np.sqrt(noise))


def _of_the_path(t: Trajectory, evidence: Evidence) -> Array:
    """Return the square [K + 1, n] that the positions' noise makes of the torque's lines, over that of its own."""
    measured, samples = t.measured, len(t.y)
    variance, share = measured.averaged_position_variance, measured.line_share
    out = np.zeros((samples // 2 + 1, t.motion.joints))
    if variance is None or share is None or not np.all(np.isfinite(variance)):
        return out
    count = min(len(out), len(share))
    second = (2.0 * np.pi * (measured.base_frequency or 0.0) * np.arange(count)[:, None]) ** 4
    inertia = np.mean(inertia_along(t, evidence) ** 2, axis=0)
    out[:count] = second * share[:count] * variance @ inertia.T / measured.averaged_variance
    return out
