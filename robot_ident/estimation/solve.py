"""Solves for all parameters of a model: linear ones by least squares, inner ones by variable projection around them.

For given inner parameters s the linear ones have a closed solution theta(s); what is left, || W^1/2 (b - F(s)
theta(s)) ||^2, is minimised over s alone (Golub and Pereyra, "The differentiation of pseudo-inverses and nonlinear
least squares problems", 1973). Effects whose columns depend on the model's torque are iterated to a fixed point.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.effects.torque_scale import TorqueScale
from robot_ident.errors import InputError
from robot_ident.estimation.instruments import instrumental_variables
from robot_ident.estimation.maximum_likelihood import maximum_likelihood
from robot_ident.estimation.problem import STEP, Problem, Solution, inner_bounds, solution
from robot_ident.estimation.projection import Projection
from robot_ident.estimation.torque_scales import with_scales
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array, joined

_MOST_STEPS = 25  # of the search for inner parameters: five of them at once take about 15


@dataclass(frozen=True)
class Estimator:
    """How parameters are estimated: what it is, whether rows are weighted by their noise, what follows the solution."""

    meaning: str
    weighted: bool
    finish: Callable[[Problem, Solution], Solution]


def _as_it_is(problem: Problem, found: Solution) -> Solution:
    return found


ESTIMATORS: dict[str, Estimator] = {
    "ls": Estimator("ordinary least squares (eq. 10)", False, _as_it_is),
    "wls": Estimator("least squares weighted by the noise (eq. 7)", True, _as_it_is),
    "ml": Estimator("maximum likelihood of parameters and trajectory together (eqs. 3 to 6)", True, maximum_likelihood),
    "iv": Estimator("instrumental variables, the model's own motion as instrument", True, instrumental_variables),
}


def solve(measurements: Sequence[Measurement], structure: Structure, estimator: str) -> Solution:
    """Return all parameters of a structure, searched from its inner parameters' grids."""
    _refuse_hidden(measurements, structure)
    problem: Problem | None = Problem(measurements, structure, weighted=ESTIMATORS[estimator].weighted)
    while problem is not None:
        used = problem
        searched = with_scales(used, structure)
        if structure.scaled:
            used = used.weighed_anew(searched)
            searched = with_scales(used, searched)
        if len(structure.inner) > len(structure.scaled):
            searched = with_scales(used, _refine(used, _scan(used, searched)))
        values, _, equations = used.linear(searched)
        problem = used.beside(values, equations)
    return ESTIMATORS[estimator].finish(used, solution(used, searched, values, equations))


def _refuse_hidden(measurements: Sequence[Measurement], structure: Structure) -> None:
    """Raise InputError where none of the measurements can show one of the effects, whatever its inner parameters."""
    for effect in structure.effects:
        reasons = []
        for measured in measurements:
            settings = [effect, *(effect.at(setting) for setting in effect.settings(measured.motion))]
            reasons += [one.hidden_in(measured.motion) for one in settings]
        if reasons and all(reasons):
            sources = ", ".join(dict.fromkeys(measured.source for measured in measurements))
            raise InputError(f"{sources}: {effect.label} can't be estimated: {reasons[0]}")


def _scan(problem: Problem, structure: Structure) -> Structure:
    """Choose the inner parameters of one effect after another from their grids, the others held."""
    reached = joined([measured.motion for measured in problem.measurements])
    for index, effect in enumerate(structure.effects):
        settings = [effect.setting, *effect.settings(reached)] if _searched(effect) else []
        if isinstance(effect, TorqueRipple):
            settings += _lines(problem, structure, effect)
        if len(settings) < 2:
            continue
        trials = [_replaced(structure, index, setting) for setting in settings]
        left = Projection.of(problem, structure, [effect.label])
        costs = [_cost(left, trial) for trial in trials]
        structure = trials[int(np.argmin(costs))]
    return structure


def _lines(problem: Problem, structure: Structure, effect: TorqueRipple) -> list[dict[str, float]]:
    """Return the orders of the highest lines of what the others leave of a ripple's joint, over its angle."""
    plain, _ = structure.with_only(lambda one: one is not effect)
    equations, white = problem.equations(plain, None), problem.noise.whiten
    values = np.linalg.lstsq(white(equations.phi), white(equations.torque), rcond=None)[0]
    left, mine = equations.torque - equations.phi @ values, equations.joint == effect.joint
    motions = [
        measured.motion[measured.rows][equations.sample[mine & (equations.block == block)]]
        for block, measured in enumerate(problem.measurements)
    ]
    fastest = min(measured.fastest for measured in problem.measurements)
    return [{"h": order} for order in effect.lines(joined(motions), left[mine], fastest)]


def _searched(effect: Effect) -> bool:
    """Return whether an effect has inner parameters that are searched on columns of its own."""
    return bool(effect.inner) and not isinstance(effect, TorqueScale)


def _cost(left: Projection, structure: Structure) -> float:
    """Return the squared error at theta(s); inf where the motion doesn't excite a column."""
    try:
        return float(np.sum(left.residual(structure) ** 2))
    except InputError:
        return float("inf")


def _replaced(structure: Structure, index: int, setting: dict[str, float]) -> Structure:
    effects = list(structure.effects)
    effects[index] = effects[index].at(setting)
    return replace(structure, effects=tuple(effects))


def _refine(problem: Problem, structure: Structure) -> Structure:
    """Refine continuous inner parameters by bounded least squares on the projected residual."""
    from scipy.optimize import least_squares

    lower, upper, free = inner_bounds(structure)
    free &= [_searched(effect) for effect in structure.effects for _ in effect.inner]
    if not free.any():
        return structure
    settings = structure.settings.copy()
    effects = [effect for effect in structure.effects if _searched(effect)]
    searched = [inner for effect in effects for inner in effect.inner if inner.continuous]

    def scaled(values: Array) -> Array:
        return np.array([inner.scaled(value) for inner, value in zip(searched, values[free].tolist(), strict=True)])

    lowest = scaled(lower)
    range_ = scaled(upper) - lowest

    def at(x: Array) -> Structure:
        moved, places = settings.copy(), lowest + range_ * x
        moved[free] = [inner.unscaled(place) for inner, place in zip(searched, places.tolist(), strict=True)]
        return structure.with_settings(moved)

    start = np.clip((scaled(settings) - lowest) / range_, 1e-6, 1 - 1e-6)
    unexplained: Array | None = None
    left = Projection.of(problem, structure, [effect.label for effect in effects])

    def rest(x: Array) -> Array:
        """Return the projected residual; where the motion no longer meets a column, as if nothing were explained."""
        nonlocal unexplained
        try:
            return left.residual(at(x))
        except InputError:
            if unexplained is None:
                unexplained = problem.noise.whiten(problem.equations(structure, None).torque)
            return unexplained

    found = least_squares(rest, start, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=_MOST_STEPS, xtol=1e-5, ftol=1e-7)
    return at(found.x)
