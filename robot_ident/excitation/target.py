"""What a design is for: the parameters of a model, and the noise through which they are seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.cramer_rao import bound_information, line_bases, line_deviations
from robot_ident.excitation.criteria import PERIODS, Evaluation, evaluate_rows, noise_variances
from robot_ident.excitation.excitation import Excitation
from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Target:
    """A model's columns and the variance of one sample's noise: torque_variance [n] (Nm)^2, position_variance [n] rad^2
    (nan: unknown); `periods` of them are averaged.

    values [p]: the estimate at which columns that depend on the torque, and the Cramer-Rao bound, are taken; None where
    there is none. estimated: whether a model gave it.
    """

    structure: Structure
    torque_variance: Array
    position_variance: Array
    periods: int = PERIODS
    values: Array | None = None
    estimated: bool = False
    notes: tuple[str, ...] = ()

    @classmethod
    def of_robot(cls, robot: Robot, effects: Sequence[str] = (), periods: int = PERIODS) -> Target:
        """Return the paper's model of a robot with further effects (`name@joint`), noise as its files say.

        Columns that depend on the torque take it from the robot's files; InputError where these give no inertias.
        """
        structure = Structure.build(robot, effects)
        variances, notes = noise_variances(robot)
        values = None
        if structure.uses_torque:
            first = next(effect.label for effect in structure.effects if effect.uses_torque)
            if not np.any(robot.rigid.parameters):
                raise InputError(
                    f"{robot.source}: the columns of {first} depend on the torque, and the URDF has no inertias:"
                    " a first model is needed (--model model.yaml)"
                )
            values = structure.true_values()
            notes = (*notes, f"the columns of {first} depend on the torque: taken from the robot's files, not measured")
        return cls(structure, variances, np.array(robot.noise.position_variance), periods, values, notes=notes)

    @classmethod
    def of_model(
        cls, model: Model, effects: Sequence[str] = (), periods: int = PERIODS, robot: Robot | None = None
    ) -> Target:
        """Return an identified model's columns with further effects, inner parameters and torque as it estimated them,
        and the noise that it measured.

        robot: the same robot from its own files, whose limits may have changed since; InputError where it is another.
        """
        robot = robot or model.robot
        structure = Structure.build(robot, [*(effect.label for effect in model.structure.added), *effects])
        if structure.names[: len(model.linear)] != model.structure.names:
            raise InputError(f"the model of robot {model.robot.name!r} does not fit robot {robot.name!r}")
        settings = structure.settings.copy()
        settings[: len(model.structure.settings)] = model.structure.settings
        structure = structure.with_settings(settings)
        values = np.zeros(len(structure.parameters))
        values[: len(model.linear)] = model.linear
        noise = robot.noise
        known = replace(
            noise,
            torque_variance=_measured(model.noise.torque_variance, noise.torque_variance),
            position_variance=_measured(model.noise.position_variance, noise.position_variance),
        )
        variances, notes = noise_variances(replace(robot, noise=known))
        return cls(structure, variances, np.array(known.position_variance), periods, values, True, notes)

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.structure.robot

    @property
    def variances(self) -> Array:
        """Variance [n] (Nm)^2 of the torque's noise in one averaged period."""
        return self.torque_variance / self.periods

    @property
    def position_variances(self) -> Array:
        """Variance [n] rad^2 of the position's noise in one averaged period; InputError where it is unknown."""
        unknown = [j for j, v in zip(self.robot.joints, self.position_variance, strict=True) if not np.isfinite(v)]
        if unknown:
            raise InputError(
                f"{self.robot.source}: criterion crlb weighs the noise on positions too, and that of"
                f" {', '.join(unknown)} is unknown: give position_variance: under joints in a robot YAML, or a model"
                " identified from periods"
            )
        return self.position_variance / self.periods

    def rows(self, excitation: Excitation) -> Array:
        """Return S^-1/2 F [N n, p] of one averaged period."""
        columns = self.structure.columns(excitation.samples(), self.values) / np.sqrt(self.variances)[:, None]
        return np.asarray(columns.reshape(-1, columns.shape[2]))

    def bound(self, excitation: Excitation) -> Array:
        """Return the information [p, p] of one averaged period about theta with noise on positions too (eq. 6)."""
        if self.values is None:
            raise ValueError("an estimate is needed")
        motion, weight = excitation.samples(), 1.0 / np.sqrt(self.variances)
        phi = self.structure.columns(motion, self.values) * weight[:, None]
        found = torque_derivatives(self.structure, motion, self.values)
        slopes = np.concatenate([found.position, found.velocity, found.acceleration], axis=2) * weight[:, None]
        orders = moving_orders(excitation)
        bases = line_bases(orders, excitation.base_frequency, excitation.times())
        deviations = line_deviations(orders, self.position_variances, motion.samples)
        return bound_information(phi, slopes, bases, deviations)

    def judge(
        self, excitations: Sequence[Excitation], *, bound: bool = False, prior: Array | None = None
    ) -> Evaluation:
        """Return what one averaged period of each excitation tells, beside information [p, p] that is there already."""
        parts = [_root(self.bound(one)) if bound else self.rows(one) for one in excitations]
        if prior is not None:
            parts.append(_root(prior))
        return evaluate_rows(np.concatenate(parts))


def moving_orders(excitation: Excitation) -> tuple[int, ...]:
    """Return the harmonics that an excitation uses."""
    used = np.any(excitation.series.a != 0.0, axis=0) | np.any(excitation.series.b != 0.0, axis=0)
    return tuple(int(k) + 1 for k in np.flatnonzero(used))


def _root(information: Array) -> Array:
    """Return rows R [p, p] with R' R = information, of a positive semidefinite matrix, normalised first."""
    length = np.sqrt(np.maximum(np.diag(information), 0.0))
    length = np.where(length > 0, length, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(length, length))
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * length)


def _measured(measured: Sequence[float | None], given: Array) -> Array:
    return np.array(
        [known if found is None else found for found, known in zip(measured, given, strict=True)], dtype=float
    )
