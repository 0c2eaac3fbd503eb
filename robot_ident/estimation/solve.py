"""Solves for all parameters of a model: linear ones by least squares, inner ones by variable projection around them.

For given inner parameters s the linear ones have a closed solution theta(s); what is left, || W^1/2 (b - F(s)
theta(s)) ||^2, is minimised over s alone (Golub and Pereyra, "The differentiation of pseudo-inverses and nonlinear
least squares problems", 1973). Effects whose columns depend on the model's torque are iterated to a fixed point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.estimation.equations import Equations, stack
from robot_ident.estimation.least_squares import factor, ordinary, weighted
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement

Estimator = Callable[[Array, Array, Array, Sequence[str], str], tuple[Array, Array]]

ESTIMATORS: dict[str, Estimator] = {"ls": ordinary, "wls": weighted}

_TORQUE_ROUNDS = 4  # of the fixed point: load friction of 10 % leaves 1e-4 of itself after four
_STEP = 1e-3  # of the range between an inner parameter's bounds, for derivatives


@dataclass(frozen=True)
class Solution:
    """Parameters [p + r] with covariance, the equations at the solution, and their noise variance [R]."""

    structure: Structure
    values: Array
    covariance: Array
    equations: Equations
    variance: Array
    condition_number: float
    notes: tuple[str, ...]


class Problem:
    """The measurements with what does not change while parameters are searched: base columns and noise."""

    def __init__(self, measurements: Sequence[Measurement], structure: Structure, estimator: str) -> None:
        """Compute the base columns once."""
        self.measurements = measurements
        self.names = structure.names
        self.source = ", ".join(measured.source for measured in measurements)
        self.estimator = ESTIMATORS[estimator]
        self.rigid = [structure.rigid_columns(measured.motion) for measured in measurements]
        self.variance, self.notes = _variances(self.equations(structure, None), structure, measurements, self.source)

    def equations(self, structure: Structure, values: Array | None) -> Equations:
        """Return the equations for given inner parameters and torques."""
        return stack(self.measurements, structure, values, self.rigid)

    def linear(self, structure: Structure, start: Array | None = None) -> tuple[Array, Array, Equations]:
        """Return (theta [p], covariance, equations) for given inner parameters."""
        if not structure.uses_torque:
            return self._once(structure, None)
        values = self._without_torque_effects(structure) if start is None else start
        for _ in range(_TORQUE_ROUNDS - 1):
            values, _, _ = self._once(structure, values)
        return self._once(structure, values)

    def _once(self, structure: Structure, torques: Array | None) -> tuple[Array, Array, Equations]:
        """Return (theta [p], covariance, equations) with the columns that belong to given parameters."""
        equations = self.equations(structure, torques)
        spread = self.variance / equations.independent
        values, covariance = self.estimator(equations.phi, equations.torque, spread, self.names, self.source)
        return values, covariance, equations

    def _without_torque_effects(self, structure: Structure) -> Array:
        """Return a first theta [p] from the columns that don't depend on torque, zero elsewhere."""
        equations = self.equations(structure, None)
        plain = np.ones(len(self.names), dtype=bool)
        start = len(structure.base.columns)
        for effect in structure.effects:
            stop = start + len(effect.coefficients)
            plain[start:stop] = not effect.uses_torque
            start = stop
        values = np.zeros(len(self.names))
        names = [name for name, kept in zip(self.names, plain, strict=True) if kept]
        spread = self.variance / equations.independent
        values[plain], _ = self.estimator(equations.phi[:, plain], equations.torque, spread, names, self.source)
        return values

    def residual(self, structure: Structure, start: Array | None = None) -> Array:
        """Return the weighted residual [R] at theta(s)."""
        values, _, equations = self.linear(structure, start)
        residual: Array = (equations.torque - equations.phi @ values) / np.sqrt(self.variance)
        return residual


def solve(measurements: Sequence[Measurement], structure: Structure, estimator: str) -> Solution:
    """Return all parameters of a structure, searched from its inner parameters' grids."""
    problem = Problem(measurements, structure, estimator)
    if structure.inner:
        structure = _refine(problem, _scan(problem, structure))
    values, covariance, equations = problem.linear(structure)
    condition = factor(equations.phi, 1.0 / problem.variance, structure.names, problem.source).condition_number
    if structure.inner:
        covariance = _joint_covariance(problem, structure, values, equations)
    all_values = np.concatenate([values, structure.settings])
    return Solution(structure, all_values, covariance, equations, problem.variance, condition, problem.notes)


def _scan(problem: Problem, structure: Structure) -> Structure:
    """Choose the inner parameters of one effect after another from their grids, the others held."""
    for index, effect in enumerate(structure.effects):
        settings = effect.settings() if effect.inner else []
        if len(settings) < 2:
            continue
        trials = [_replaced(structure, index, setting) for setting in settings]
        costs = [float(np.sum(problem.residual(trial) ** 2)) for trial in trials]
        structure = trials[int(np.argmin(costs))]
    return structure


def _replaced(structure: Structure, index: int, setting: dict[str, float]) -> Structure:
    from dataclasses import replace

    effects = list(structure.effects)
    effects[index] = effects[index].at(setting)
    return replace(structure, effects=tuple(effects))


def _bounds(structure: Structure) -> tuple[Array, Array, np.ndarray]:
    """Return lower and upper bounds [r] of the inner parameters and which of them are continuous."""
    inner = [inner for effect in structure.effects for inner in effect.inner]
    lower, upper = (np.array([getattr(i, side) for i in inner]) for side in ("lower", "upper"))
    return lower, upper, np.array([i.continuous for i in inner], dtype=bool)


def _refine(problem: Problem, structure: Structure) -> Structure:
    """Refine continuous inner parameters by bounded least squares on the projected residual."""
    from scipy.optimize import least_squares

    lower, upper, free = _bounds(structure)
    if not free.any():
        return structure
    settings = structure.settings.copy()
    range_ = (upper - lower)[free]

    def at(x: Array) -> Structure:
        moved = settings.copy()
        moved[free] = lower[free] + range_ * x
        return structure.with_settings(moved)

    start = np.clip((settings[free] - lower[free]) / range_, 1e-6, 1 - 1e-6)
    found = least_squares(
        lambda x: problem.residual(at(x)), start, bounds=(0.0, 1.0), diff_step=_STEP, max_nfev=15, xtol=1e-5, ftol=1e-7
    )
    return at(found.x)


def _joint_covariance(problem: Problem, structure: Structure, values: Array, equations: Equations) -> Array:
    """Return the covariance [p + r] from the Jacobian in linear and inner parameters; a fixed one has variance 0."""
    lower, upper, free = _bounds(structure)
    settings = structure.settings
    columns = [equations.phi]
    for k in np.flatnonzero(free):
        step = _STEP * (upper[k] - lower[k])
        ends = []
        for side in (-1.0, 1.0):
            moved = settings.copy()
            moved[k] = np.clip(moved[k] + side * step, lower[k], upper[k])
            ends.append((moved[k], problem.equations(structure.with_settings(moved), values).phi @ values))
        columns.append(((ends[1][1] - ends[0][1]) / (ends[1][0] - ends[0][0]))[:, None])
    jacobian = np.hstack(columns)
    p = equations.phi.shape[1]
    names = [*structure.names, *(structure.inner[k].name for k in np.flatnonzero(free))]
    weight = equations.independent / problem.variance
    small = factor(jacobian, weight, names, problem.source).inverse_information()
    covariance = np.zeros((p + len(settings),) * 2)
    place = np.concatenate([np.arange(p), p + np.flatnonzero(free)])
    covariance[np.ix_(place, place)] = small
    return covariance


def _variances(
    equations: Equations, structure: Structure, measurements: Sequence[Measurement], source: str
) -> tuple[Array, tuple[str, ...]]:
    """Return the noise variance of every row; from the residual of ordinary least squares where no periods tell it."""
    unknown = ~np.isfinite(equations.variance) | (equations.variance <= 0)
    if not unknown.any():
        return equations.variance, ()
    ones = np.ones(equations.rows)
    silent = np.linalg.norm(equations.phi, axis=0) == 0.0
    silent[: len(structure.base.columns)] = False  # of effects that depend on a torque not known yet
    names = [name for name, drop in zip(structure.names, silent, strict=True) if not drop]
    phi = equations.phi[:, ~silent]
    theta, _ = ordinary(phi, equations.torque, ones, names, source)
    residual = equations.torque - phi @ theta
    variance = equations.variance.copy()
    share = equations.rows / (equations.rows - len(names))
    for block in range(len(measurements)):
        for joint in range(structure.robot.n):
            rows = (equations.block == block) & (equations.joint == joint) & unknown
            if rows.any():
                variance[rows] = max(float(np.mean(residual[rows] ** 2)) * share, 1e-12)
    return variance, ("noise unknown without periods: rows weighted by the residual of ordinary least squares",)
