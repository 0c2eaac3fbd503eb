"""The measurements as a judge sees them: torque and columns in units of the noise, trajectory by trajectory."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from robot_ident.effects import Effect, Torques
from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.normal_equations import least_squares
from robot_ident.signals.motion import Array, Mask, Motion

_FEW = 0.5  # share of the rows, below which those that are not used are worth leaving out


@dataclass(frozen=True)
class Trajectory:
    """One trajectory: its averaged motion, torque over noise y [N, n] and weight [N, n] (1 / sigma, 0 where a row is
    not used).

    dof [n]: independent rows of each joint. measured: where it comes from. whitening [K + 1, n]: factors on the Fourier
    lines of what is weighed, so that each is in units of its own noise; None where all are alike.
    """

    measured: Measurement
    motion: Motion
    weight: Array
    y: Array
    dof: Array
    whitening: Array | None = None

    def weighed(self, columns: Array) -> Array:
        """Return columns [N, n, k] (Nm) low-passed as the torque is, and in units of the noise."""
        return self.in_noise(self.measured.passed(columns))

    def in_noise(self, passed: Array, joints: Sequence[int] | None = None) -> Array:
        """Return low-passed columns [N, joints, k] (Nm) in units of the noise; joints: all of them unless told."""
        chosen = slice(None) if joints is None else list(joints)
        weight = self.weight[:, chosen, None]
        if self.used is None:
            rows = passed * weight
        else:  # what is left zero takes no memory
            rows = np.zeros(passed.shape)
            rows[self.used] = passed[self.used] * weight[self.used]
        if self.whitening is None:
            return rows
        lines = np.fft.rfft(rows, axis=0) * self.whitening[:, chosen, None]
        return np.asarray(np.fft.irfft(lines, len(rows), axis=0))

    def transposed(self, rows: Array) -> Array:
        """Return rows [N, n, k] in units of the noise through the transpose of `in_noise`, which is linear."""
        if self.whitening is not None:
            lines = np.fft.rfft(rows, axis=0) * self.whitening[:, :, None]
            rows = np.fft.irfft(lines, len(rows), axis=0)
        return np.asarray(rows * self.weight[:, :, None])

    @cached_property
    def used(self) -> Mask | None:
        """Rows [N] that weighed columns have where they are few: all others are zero; None where they may be many."""
        used = np.asarray((self.weight > 0).any(axis=1))
        return used if self.whitening is None and used.mean() < _FEW else None

    def times(self, columns: Array, matrix: Array) -> Array:
        """Return weighed columns [N, n, p] times a matrix [p, k]."""
        if self.used is None:
            return np.asarray(columns @ matrix)
        out = np.zeros((*columns.shape[:2], matrix.shape[1]))
        out[self.used] = columns[self.used] @ matrix
        return out

    def beside(self, first: Array, second: Array) -> Array:
        """Return weighed columns [N, n, p] and [N, n, k] as one [N, n, p + k]."""
        if self.used is None:
            return np.concatenate([first, second], axis=2)
        out = np.zeros((*first.shape[:2], first.shape[2] + second.shape[2]))
        for columns, part in ((slice(None, first.shape[2]), first), (slice(first.shape[2], None), second)):
            out[self.used, :, columns] = part[self.used]
        return out

    def stacked(self, rows: Array) -> Array:
        """Return weighed rows [N, n, ...] of all joints below one another, without those that are zero for certain."""
        some = rows if self.used is None else rows[self.used]
        return some.reshape(-1, *rows.shape[2:])

    def plain(self, rows: Array) -> Array:
        """Return weighed rows [N, n] with their lines as they were before they were put in units of their noise."""
        if self.whitening is None:
            return rows
        return np.asarray(np.fft.irfft(np.fft.rfft(rows, axis=0) / self.whitening, len(rows), axis=0))

    def weighed_by(self, weight: Array) -> Trajectory:
        """Return the trajectory with another weight [N, n], 0 in rows more than before."""
        share = (weight > 0).sum(axis=0) / np.maximum(1, (self.weight > 0).sum(axis=0))
        other = replace(self, weight=weight, dof=self.dof * share)
        return replace(other, y=other.weighed(self.measured.torque[:, :, None])[:, :, 0])


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
    """Return columns(place) [N, joints, k] as `Trajectory.weighed` does, once for all parts of one measurement."""
    passed: dict[int, Array] = {}
    for place, t in enumerate(trajectories):
        if id(t.measured) not in passed:
            passed[id(t.measured)] = t.measured.passed(columns(place))
    return tuple(t.in_noise(passed[id(t.measured)], joints) for t in trajectories)


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


def split(evidence: Evidence, parts: int = 4, block: float | None = None) -> Evidence:
    """Return the evidence with its one trajectory cut into parts of time that can be left out in turn.

    Parts in one piece, or, with a block's length [s], blocks dealt out to the parts in turn.
    """
    (whole,) = evidence.trajectories
    rows = np.arange(len(whole.y))
    size = len(rows) / parts if block is None else block / (whole.measured.dt * whole.measured.decimate)
    part = (rows // max(1.0, size)).astype(int)
    part = np.minimum(part, parts - 1) if block is None else part % parts
    pieces = []
    for number in range(parts):
        pieces.append(whole.weighed_by(np.where((part == number)[:, None], whole.weight, 0.0)))
    return fitted(evidence.structure, tuple(pieces), evidence.rigid * parts, kept_between_parts(evidence))


def kept_between_parts(evidence: Evidence) -> dict[Hashable, object]:
    """Return what an evidence remembers that holds for parts of its trajectories, too: what is not weighed."""
    return {key: kept for key, kept in evidence.memory.items() if isinstance(key, tuple) and key[0] == _RIGID}
