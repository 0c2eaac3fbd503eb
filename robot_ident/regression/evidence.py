"""The measurements as a judge sees them: torque and columns in units of the noise, trajectory by trajectory."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from robot_ident.effects import Effect, Torques
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.normal_equations import least_squares
from robot_ident.signals.motion import Array, Mask, Motion


@dataclass(frozen=True)
class Trajectory:
    """One trajectory: its averaged motion, torque over noise y [N, n] and weight [N, n] (1 / sigma, 0 where a row is
    not used).

    dof [n]: independent rows of each joint. measured: where it comes from. whitening [K + 1, n]: factors on the Fourier
    lines of what is weighed, so that each is in units of its own noise; None where all are alike. whole, rows: of a
    part of time, the trajectory that it is cut out of and its rows there; weighed as the whole, zero in all others.
    """

    measured: Measurement
    motion: Motion
    weight: Array
    y: Array
    dof: Array
    whitening: Array | None = None
    whole: Trajectory | None = None
    rows: slice = field(default_factory=partial(slice, None))

    @property
    def uncut(self) -> Trajectory:
        """The trajectory that this one is a part of, itself where it is none."""
        return self.whole or self

    def weighed(self, columns: Array) -> Array:
        """Return columns [N, n, k] (Nm) low-passed as the torque is, and in units of the noise."""
        return self.in_noise(self.measured.passed(columns))

    def in_noise(self, passed: Array, joints: Sequence[int] | None = None) -> Array:
        """Return low-passed columns [N, joints, k] (Nm) in units of the noise; joints: all of them unless told."""
        if self.whole is not None:
            return self.cut(self.whole.in_noise(passed, joints))
        chosen = slice(None) if joints is None else list(joints)
        rows = passed * self.weight[:, chosen, None]
        if self.whitening is None:
            return rows
        lines = np.fft.rfft(rows, axis=0) * self.whitening[:, chosen, None]
        return np.asarray(np.fft.irfft(lines, len(rows), axis=0))

    def cut(self, rows: Array) -> Array:
        """Return rows [N, ...] of the whole with zero outside of the part's; what is left zero takes no memory."""
        if self.whole is None:
            return rows
        out = np.zeros(rows.shape)
        out[self.rows] = rows[self.rows]
        return out

    def times(self, columns: Array, matrix: Array) -> Array:
        """Return weighed columns [N, n, p] times a matrix [p, k]."""
        out = np.zeros((*columns.shape[:2], matrix.shape[1]))
        out[self.rows] = columns[self.rows] @ matrix
        return out

    def beside(self, *some: Array) -> Array:
        """Return several weighed columns [N, n, k] each as one [N, n, sum of k]."""
        out = np.zeros((*some[0].shape[:2], sum(one.shape[2] for one in some)))
        np.concatenate([one[self.rows] for one in some], axis=2, out=out[self.rows])
        return out

    def stacked(self, rows: Array) -> Array:
        """Return weighed rows [N, n, ...] of all joints below one another, without those of other parts."""
        return rows[self.rows].reshape(-1, *rows.shape[2:])

    def plain(self, rows: Array) -> Array:
        """Return weighed rows [N, n] with their lines as they were before they were put in units of their noise."""
        if self.whitening is None:
            return rows
        return np.asarray(np.fft.irfft(np.fft.rfft(rows, axis=0) / self.whitening, len(rows), axis=0))

    def whitened_by(self, whitening: Array | None) -> Trajectory:
        """Return the trajectory with another whitening [K + 1, n]."""
        other = replace(self, whitening=whitening)
        return replace(other, y=other.weighed(self.measured.torque[:, :, None])[:, :, 0])

    def part(self, rows: slice) -> Trajectory:
        """Return some rows of the trajectory as one of its own."""
        weight = np.zeros(self.weight.shape)
        weight[rows] = self.weight[rows]
        share = (weight > 0).sum(axis=0) / np.maximum(1, (self.weight > 0).sum(axis=0))
        part = replace(self, weight=weight, dof=self.dof * share, whole=self, rows=rows)
        return replace(part, y=part.cut(self.y))


@dataclass(frozen=True)
class Evidence:
    """Trajectories with the columns of a model on them; `phi` [N, n, p] and `rigid` for each trajectory.

    memory: what was computed on these trajectories and does not depend on the model, shared by all evidence on them.
    """

    structure: Structure
    trajectories: tuple[Trajectory, ...]
    rigid: tuple[Array, ...]
    phi: tuple[Array, ...]
    values: Array
    memory: dict[Hashable, object] = field(default_factory=dict, compare=False, repr=False)

    @property
    def recordings(self) -> tuple[Measurement, ...]:
        """The measurements, each once where parts of it are left out in turn."""
        return tuple({id(t.measured): t.measured for t in self.trajectories}.values())

    @property
    def residual(self) -> tuple[Array, ...]:
        """Weighed residual [N, n] of each trajectory."""
        return tuple(t.y - phi @ self.values for t, phi in zip(self.trajectories, self.phi, strict=True))

    @property
    def newton(self) -> tuple[Array, ...]:
        """Residual [N, n] Nm of each trajectory, low-passed as the torque is, 0 where a row is not used."""
        pairs = zip(self.trajectories, self.residual, strict=True)
        return tuple(t.plain(r) / np.where(t.weight > 0, t.weight, np.inf) for t, r in pairs)

    @cached_property
    def torques(self) -> tuple[Torques, ...]:
        """The model's torques along each trajectory, for effects that depend on them."""
        known: dict[int, Torques] = {}
        for t, rigid in zip(self.trajectories, self.rigid, strict=True):
            if id(t.measured) not in known:
                known[id(t.measured)] = self.structure.torques(t.motion, self.values, rigid)
        return tuple(known[id(t.measured)] for t in self.trajectories)


def trajectory(measured: Measurement) -> Trajectory:
    """Return a measurement in units of its noise; InputError where the noise is unknown."""
    variance = measured.averaged_variance
    if not np.all(np.isfinite(variance)) or np.any(variance <= 0):
        raise InputError(
            f"{measured.source}: its noise is unknown without periods;"
            " record at least 2 (better 8 or more) periods of a motion"
        )
    used: Mask = measured.used[measured.rows]
    # rows that a low pass has smeared share their noise: their weight in chi-square is that of the independent ones
    weight = used.astype(float) * np.sqrt(measured.independent / variance)
    y = measured.passed(measured.torque) * weight
    return Trajectory(measured, measured.motion, weight, y, used.sum(axis=0) * measured.independent)


def gather(measurements: Sequence[Measurement], structure: Structure) -> Evidence:
    """Return the evidence on a model with its linear parameters fitted to all trajectories."""
    trajectories = tuple(trajectory(measured) for measured in measurements)
    rigid = tuple(structure.rigid_columns(t.motion) for t in trajectories)
    return fitted(structure, trajectories, rigid)


_RIGID = "rigid"  # of the memory: low-passed columns of the links, by measurement


def weighed_once(
    trajectories: Sequence[Trajectory], columns: Callable[[int], Array], joints: Sequence[int] | None = None
) -> tuple[Array, ...]:
    """Return columns(place) [N, joints, k] as `Trajectory.weighed` does, once for all parts of one trajectory."""
    return tuple(
        t.cut(rows) for t, rows in zip(trajectories, weighed_uncut(trajectories, columns, joints), strict=True)
    )


def weighed_uncut(
    trajectories: Sequence[Trajectory], columns: Callable[[int], Array], joints: Sequence[int] | None = None
) -> list[Array]:
    """Return the same in all rows of the trajectories that they are parts of."""
    made: dict[int, Array] = {}
    for place, t in enumerate(trajectories):
        if id(t.uncut) not in made:
            made[id(t.uncut)] = t.uncut.in_noise(t.measured.passed(columns(place)), joints)
    return [made[id(t.uncut)] for t in trajectories]


def fitted(
    structure: Structure,
    trajectories: tuple[Trajectory, ...],
    rigid: tuple[Array, ...],
    memory: dict[Hashable, object] | None = None,
) -> Evidence:
    """Return the evidence with the linear parameters fitted; columns that depend on torque are iterated."""
    memory = {} if memory is None else memory
    values = np.zeros(len(structure.names))
    own = rigid[0].shape[2]
    pairs = zip(trajectories, rigid, strict=True)
    links = tuple(t.in_noise(structure.reported(_passed_rigid(t, r, memory))) for t, r in pairs)

    def effects(place: int) -> Array:
        return structure.columns(trajectories[place].motion, values, rigid[place])[:, :, own:]

    for _ in range(3 if structure.uses_torque else 1):
        further = weighed_once(trajectories, effects)
        phi = tuple(t.beside(*pair) for t, *pair in zip(trajectories, links, further, strict=True))
        rows = [t.stacked(part) for t, part in zip(trajectories, phi, strict=True)]
        values = least_squares(rows, [t.stacked(t.y) for t in trajectories])
    return Evidence(structure, trajectories, rigid, phi, values, memory)


def _passed_rigid(t: Trajectory, rigid: Array, memory: dict[Hashable, object]) -> Array:
    """Return the low-passed columns of the links, computed once for all models on a measurement."""
    key = (_RIGID, id(t.measured))
    if key not in memory:
        memory[key] = t.measured.passed(rigid)
    found = memory[key]
    assert isinstance(found, np.ndarray)
    return found


def extended(evidence: Evidence, effects: Sequence[Effect]) -> Evidence:
    """Return the evidence on the model with further effects."""
    structure = evidence.structure.with_further(effects)
    return fitted(structure, evidence.trajectories, evidence.rigid, evidence.memory)


def held(evidence: Evidence, structure: Structure, values: Array) -> Evidence:
    """Return the evidence on another model of the same robot as it stands, linear parameters values [p] included."""
    pairs = zip(evidence.trajectories, evidence.rigid, strict=True)
    phi = tuple(t.weighed(structure.columns(t.motion, values, rigid)) for t, rigid in pairs)
    return Evidence(structure, evidence.trajectories, evidence.rigid, phi, values, evidence.memory)


def split(evidence: Evidence, parts: int) -> Evidence:
    """Return the evidence with its one trajectory cut into parts of time that can be left out in turn."""
    (whole,) = evidence.trajectories
    ends = np.linspace(0, len(whole.y), parts + 1).round().astype(int)
    pieces = tuple(whole.part(slice(*pair)) for pair in zip(ends[:-1], ends[1:], strict=True))
    phi = tuple(one.cut(evidence.phi[0]) for one in pieces)
    memory = kept_between_parts(evidence)
    return Evidence(evidence.structure, pieces, evidence.rigid * parts, phi, evidence.values, memory)


def kept_between_parts(evidence: Evidence) -> dict[Hashable, object]:
    """Return what an evidence remembers that holds for parts of its trajectories, too: what is not weighed."""
    return {key: kept for key, kept in evidence.memory.items() if isinstance(key, tuple) and key[0] == _RIGID}
