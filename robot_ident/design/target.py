"""What a design is for: a model's parameters or a payload's, their noise, and how many periods make them precise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.design.criteria import (
    PERIODS,
    Evaluation,
    bound_information,
    evaluate_rows,
    line_bases,
    line_deviations,
    noise_variances,
)
from robot_ident.errors import InputError
from robot_ident.model.base_parameters import random_states
from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation


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
            words = f"the columns of {first} depend on the torque"
            values = values_of_files(structure, words)
            notes = (*notes, f"{words}: taken from the robot's files, not measured")
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
        notes = model.leading(notes)
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
        return self.weighted(excitation.samples(), self.variances)

    def weighted(self, motion: Motion, variances: Array) -> Array:
        """Return S^-1/2 F [N n, p] along a motion, for noise of given variances [n] (Nm)^2 of the torque."""
        columns = self.structure.columns(motion, self.values) / np.sqrt(variances)[:, None]
        return np.asarray(columns.reshape(-1, columns.shape[2]))

    def bound(self, excitation: Excitation) -> Array:
        """Return the information [p, p] of one averaged period about theta with noise on positions too (eq. 6)."""
        if self.values is None:
            raise ValueError("an estimate is needed")
        motion, weight = excitation.samples(), 1.0 / np.sqrt(self.variances)
        phi = self.structure.columns(motion, self.values) * weight[:, None]
        found = torque_derivatives(self.structure, motion, self.values)
        slopes = np.concatenate([found.position, found.velocity, found.acceleration], axis=2) * weight[:, None]
        used = np.any(excitation.series.a != 0.0, axis=0) | np.any(excitation.series.b != 0.0, axis=0)
        orders = (1 + np.flatnonzero(used)).tolist()
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


def values_of_files(structure: Structure, words: str) -> Array:
    """Return the parameters [p] that a robot's files give; InputError, with `words` why, where they lack inertias."""
    if not np.any(structure.robot.rigid.parameters):
        raise InputError(
            f"{structure.robot.source}: {words}, and the URDF has no inertias: a first model is needed (--model"
            " model.yaml)"
        )
    return structure.true_values()


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


_SAMPLES = 1500  # of a period
_FIRMLY = 1e3  # times what one averaged period of a motion tells of the arm


def all_but_payload(target: Target) -> Array:
    """Return information [p, p] about everything that a payload leaves as it is: a prior for a design.

    A payload changes the ten parameters of the last link; in the base parameters that is R_last pi, so that what stands
    across R_last is known: P = k N N' with N' R_last = 0, in units of what the noise makes of each parameter. Friction
    stays free: it differs with the load.
    """
    structure = target.structure
    own = structure.base.regrouping[:, 10 * (target.robot.n - 1) : 10 * target.robot.n]
    size = _sizes(target)
    base = size[: len(own)]
    left, values, _ = np.linalg.svd(own / base[:, None])
    rank = int(np.sum(values > 1e-9 * values[0]))
    across = left[:, rank:] / base[:, None]
    lasting = {effect.name for effect in structure.effects if effect.symmetry == "conservative"}
    firm = [p.effect in lasting for p in structure.parameters]
    out = np.diag(np.where(firm, (_FIRMLY / size) ** 2, 0.0))
    out[: len(own), : len(own)] = _FIRMLY**2 * across @ across.T
    return out


def _sizes(target: Target) -> Array:
    """Return each parameter's sigma alone [p] over random states of a period; of effects, as if columns were 1."""
    columns = target.structure.rigid_columns(random_states(target.robot))
    rigid = np.mean(np.sum(columns**2 / target.variances[:, None], axis=1), axis=0)
    further = len(target.structure.parameters) - len(rigid)
    power = np.concatenate([rigid, np.full(further, float(np.mean(1.0 / target.variances)))])
    return np.asarray(1.0 / np.sqrt(_SAMPLES * np.where(power > 0, power, 1.0)))


_MOST = 1_000_000  # periods: more are never
_OPEN = 1e-6  # share of a direction that no data tell, from which on a parameter is not told either


@dataclass(frozen=True)
class Needed:
    """Periods after which a parameter's standard deviation is the share of its value that was asked for.

    sigma: of one period alone (and a prior). periods: None where no number of them is enough, or the value is not
    known.
    """

    name: str
    value: float
    sigma: float
    periods: int | None
    unit: str


def periods_needed(
    information: Array,
    values: Array,
    names: Sequence[str],
    units: Sequence[str],
    share: float,
    prior: Array | None = None,
) -> tuple[Needed, ...]:
    """Return how many periods each parameter takes: the least M with sigma_M <= share |value|.

    sigma_M^2 = diag (prior + M J)^-1, J [p, p] the information of one period (Swevers et al. 1997, eq. 9), for noise
    alone: what a model lacks does not average out. values [p], 0 where they are not known.
    """
    deviations = _Deviations(information, prior)
    one = deviations(1)
    return tuple(
        Needed(name, float(value), float(one[k]), deviations.periods(k, share * abs(float(value))), unit)
        for k, (name, value, unit) in enumerate(zip(names, values, units, strict=True))
    )


class _Deviations:
    """Standard deviations [p] after so many periods."""

    def __init__(self, information: Array, prior: Array | None) -> None:
        self._scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        unit = np.outer(self._scale, self._scale)
        self._one, self._known = information / unit, np.zeros_like(unit) if prior is None else prior / unit

    def __call__(self, periods: int) -> Array:
        values, vectors = np.linalg.eigh(self._known + periods * self._one)
        told = values > len(values) * np.finfo(float).eps * values[-1]
        variance = (vectors[:, told] ** 2) @ (1.0 / values[told])
        variance[np.any(np.abs(vectors[:, ~told]) > _OPEN, axis=1)] = np.inf
        return np.asarray(np.sqrt(variance) / self._scale)

    def periods(self, parameter: int, wanted: float) -> int | None:
        """Return the least number after which a parameter's deviation is no more than `wanted`, None for never."""
        if wanted <= 0.0 or self(_MOST)[parameter] > wanted:
            return None
        low, high = 0, _MOST
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self(middle)[parameter] <= wanted else (middle, high)
        return high
