"""The stacked equations F theta = b of one or several measurements (Swevers et al. 1997, eq. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robot_ident.effects import Effect
from robot_ident.errors import InputError
from robot_ident.model.model import Fit
from robot_ident.model.rigid_sensitivity import RigidSensitivity
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import refuse_silent
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Equations:
    """Rows that count, of all measurements and joints.

    phi [R, p], torque [R] Nm, both averaged and low-passed; joint [R], block [R]: which joint and measurement a row
    belongs to; sample [R]: its place among the (decimated) rows of that measurement; variance [R] (Nm)^2 of its noise,
    nan where unknown; independent [R]: share of independent noise among its neighbours.
    """

    phi: Array
    torque: Array
    joint: np.ndarray
    block: np.ndarray
    sample: np.ndarray
    variance: Array
    independent: Array

    @property
    def rows(self) -> int:
        """Number of rows R."""
        return len(self.torque)

    def of_joints(self, block: int) -> list[np.ndarray]:
        """Return the rows of each joint of a measurement, of those that have some."""
        joints = (self.joint == joint for joint in np.unique(self.joint[self.block == block]))
        return [(self.block == block) & own for own in joints]

    def fits(self, residual: Array, joints: Sequence[str]) -> dict[str, Fit]:
        """Return by joint how well a model follows that leaves a residual [R] Nm."""
        own = {name: self.joint == number for number, name in enumerate(joints)}
        return {name: fit(residual[rows], self.torque[rows], self.variance[rows]) for name, rows in own.items()}

    def put(self, out: Array, block: int, whole: Array) -> np.ndarray:
        """Write a measurement's passed values [N, n, ...] to its rows of `out` [R, ...]; return these rows."""
        rows = self.block == block
        out[rows] = whole[self.sample[rows], self.joint[rows]]
        return rows


def fit(residual: Array, torque: Array, variance: Array) -> Fit:
    """Return how well a model follows one joint: residual, torque and noise variance of its rows [R]."""
    mse, noise, size = float(np.mean(residual**2)), float(np.mean(variance)), float(np.sum(torque**2))
    relative = float(np.sqrt(np.sum(residual**2) / size)) if size else None
    return Fit(mse, float(np.sqrt(mse)), noise if np.isfinite(noise) else None, relative)


class Compared:
    """One measurement's torque and columns as they are compared, low-passed and decimated; while inner parameters are
    searched, what does not change from one trial to the next is passed once.
    """

    def __init__(self, measured: Measurement, structure: Structure) -> None:
        """Compute the columns of the links."""
        self.measured = measured
        self.rigid = structure.rigid_columns(measured.motion)
        self._kept: dict[str, tuple[object, Array]] = {}
        self._arm: tuple[bytes, RigidSensitivity] | None = None

    @cached_property
    def torque(self) -> Array:
        """[N, n] Nm."""
        return self.measured.passed(self.measured.torque)

    @cached_property
    def _links(self) -> Array:
        return self.measured.passed(self.rigid)

    def columns(self, structure: Structure, values: Array | None) -> Array:
        """Return Phi [N, n, p]; values [p]: where columns depend on the model's torque."""
        arm = None
        if structure.uses_torque and values is not None:
            state = values[: self.rigid.shape[2]].tobytes() + structure.scales.tobytes()
            if self._arm is None or self._arm[0] != state:
                self._arm = state, structure.sensitivity(self.measured.motion, values)
            arm = self._arm[1]
        _, *parts = structure.parts(self.measured.motion, values, self.rigid, arm)
        passed = [self._passed(structure, *pair) for pair in zip(structure.effects, parts, strict=True)]
        return np.concatenate([structure.reported(self._links), *passed], axis=2)

    def rows_of(self, structure: Structure, effects: Sequence[Effect]) -> Array:
        """Return the columns [R, k] of some effects that don't depend on torque, in the rows of `stack`."""
        motion = self.measured.motion
        parts = [self._passed(structure, effect, structure.columns_of(effect, motion)) for effect in effects]
        columns = np.concatenate(parts, axis=2)
        return np.asarray(columns.swapaxes(0, 1)[self.measured.used[self.measured.rows].T])

    def _passed(self, structure: Structure, effect: Effect, columns: Array) -> Array:
        """Return an effect's columns as they are compared, as they were where nothing has changed."""
        if effect.uses_torque:
            return self.measured.passed(columns)
        scales = structure.scales.tobytes() if effect.through_links else b""
        state = (effect.setting, effect.coefficients, scales)
        if effect.label not in self._kept or self._kept[effect.label][0] != state:
            self._kept[effect.label] = state, self.measured.passed(columns)
        return self._kept[effect.label][1]


def stack(
    measurements: Sequence[Measurement],
    structure: Structure,
    values: Array | None = None,
    compared: Sequence[Compared] | None = None,
) -> Equations:
    """Return the equations of some measurements; InputError when a joint has too few rows.

    values [p]: where columns depend on the model's torque. compared: the measurements as they are compared, where
    their columns are computed again and again.
    """
    refuse_silent(measurements, "; identify the others alone: --joints {moving}")
    source = ", ".join(measured.source for measured in measurements)
    parts: list[list[np.ndarray]] = []
    for block, measured in enumerate(measurements):
        one = Compared(measured, structure) if compared is None else compared[block]
        phi, torque = one.columns(structure, values), one.torque
        used = measured.used[measured.rows]
        variance = measured.averaged_variance
        for joint in range(structure.robot.n):
            rows = used[:, joint]
            count = int(rows.sum())
            equal = (np.full(count, value) for value in (joint, block, variance[joint], measured.independent))
            joint_of, block_of, noise, independent = equal
            sample = np.flatnonzero(rows)
            parts.append([phi[rows, joint], torque[rows, joint], joint_of, block_of, sample, noise, independent])
    stacked = Equations(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    if stacked.rows <= len(structure.parameters):
        raise InputError(
            f"{source}: {stacked.rows} usable samples are too few for {len(structure.parameters)} parameters"
        )
    return stacked


_GROUPS = 4  # of periods: enough to tell a level, a slope and a bend


def apart(measurements: Sequence[Measurement], effects: Sequence[Effect]) -> Sequence[Measurement]:
    """Return measurements whose periods are averaged in up to four groups, one after the other, where one of the
    effects trends; else the measurements as they are.

    Their mean tells the level of such an effect, only their differences its course. Raises InputError where every
    recording is an average whose periods are not known one by one.
    """
    trending = [effect.label for effect in effects if effect.trends]
    if not trending:
        return measurements
    parts = [group for measured in measurements for group in _groups(measured)]
    if all(one.motion.periodic for one in measurements) and len(parts) == len(measurements):
        sources = ", ".join(dict.fromkeys(measured.source for measured in measurements))
        raise InputError(
            f"{sources}: {', '.join(trending)} can't be estimated: it shows in what single periods differ by, and these"
            " are not known one by one; record at an even sample rate of which the period is a multiple"
        )
    return parts


def _groups(measured: Measurement) -> list[Measurement]:
    periods = measured.period_torque
    if periods is None or len(periods) < 2 or len(periods) != len(measured.motion.began):
        return [measured]
    out = []
    for rows in np.array_split(np.arange(len(periods)), min(_GROUPS, len(periods))):
        present, share = np.isfinite(periods[rows]), len(rows) / len(periods)
        group = replace(
            measured,
            motion=replace(measured.motion, began=tuple(measured.motion.began[k] for k in rows)),
            torque=np.where(present, periods[rows], 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1),
            used=measured.used & present.any(axis=0),
            periods=len(rows),
            averages=measured.averages * share,
            variance_dof=measured.variance_dof * share,
            period_torque=None,
        )
        out.append(group)
    return out
