"""Solves for all parameters of a model: linear ones by least squares, inner ones by variable projection around them.

For given inner parameters s the linear ones have a closed solution theta(s); what is left, || W^1/2 (b - F(s)
theta(s)) ||^2, is minimised over s alone (Golub and Pereyra, "The differentiation of pseudo-inverses and nonlinear
least squares problems", 1973). Effects whose columns depend on the model's torque are iterated to a fixed point.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from robot_ident.effects import Effect
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.effects.torque_scale import SPREAD, TorqueScale
from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.instruments import instrumental_variables
from robot_ident.estimation.least_squares import Factor, held_softly
from robot_ident.estimation.maximum_likelihood import maximum_likelihood
from robot_ident.estimation.problem import STEP, OtherForm, Problem, Solution, inner_bounds, solution
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array, joined

_LESS = 1e-6  # of the squared error, by which another form must leave less to be taken
_FAR = 30.0  # more of chi-square: a form that leaves it is less likely than one in a million
_ROUNDS = 30  # of the search for torque scales
_STEP = 0.3  # of ln a, in one of them
_SETTLED = 1e-8  # of ln a, between them
_MOST_STEPS = 25  # of the search for inner parameters: five of them at once take about 15


@dataclass(frozen=True)
class Projection:
    """What a model leaves of the torque while the inner parameters of some effects are searched.

    With F = [A, B(s)], A [R, a] the columns that stay, and A = Q R, a trial of s factorises B - Q Q' B alone. searched:
    labels of these effects. near [p]: linear parameters whose torque other effects see meanwhile, None where none does.
    order [p]: columns that stay, then those that move. fixed: A, stays: its factorisation, both [R, a].
    """

    problem: Problem
    searched: Collection[str]
    near: Array | None
    order: np.ndarray
    stays: Factor
    fixed: Array
    torque: Array

    @classmethod
    def of(
        cls, problem: Problem, structure: Structure, searched: Collection[str], near: Array | None = None
    ) -> Projection | Whole:
        """Take up a search over the inner parameters of the effects whose labels are given; near [p]: linear parameters
        whose torque other effects see meanwhile, where they are known. Where the motion doesn't excite a column, which
        it may with other inner parameters, every trial is solved as a whole.
        """
        moves = structure.places_of(lambda effect: effect.label in searched or effect.uses_torque)
        order = np.concatenate([np.flatnonzero(~moves), np.flatnonzero(moves)])
        try:
            if not structure.uses_torque:
                near = None
            elif near is None:
                near = problem.linear(structure)[0]
            held = order[: int(np.sum(~moves))]
            equations = problem.equations(structure, near)
            fixed = equations.phi[:, held]
            stays = problem.factored(fixed, [problem.names[k] for k in held])
        except InputError:
            return Whole(problem)
        return cls(problem, searched, near, order, stays, fixed, equations.torque)

    def residual(self, structure: Structure) -> Array:
        """Return the whitened residual [R] at theta(s); InputError where the motion doesn't excite a column."""
        moving, names = self._moving(structure), [self.problem.names[k] for k in self.order]
        further, torque = self.problem.right(moving), self.problem.right(self.torque)
        values = self.stays.solve_beside(further, names, self.problem.source, torque)
        own, moved = np.split(values, [self.fixed.shape[1]])
        return self.problem.noise.whiten(self.torque - self.fixed @ own - moving @ moved)

    def _moving(self, structure: Structure) -> Array:
        """Return the columns [R, k] that move."""
        if structure.uses_torque:
            return self.problem.equations(structure, self.near).phi[:, self.order[self.fixed.shape[1] :]]
        return self.problem.columns_of(structure, [e for e in structure.effects if e.label in self.searched])


@dataclass(frozen=True)
class Whole:
    """What a model leaves of the torque where every trial is solved as a whole."""

    problem: Problem

    def residual(self, structure: Structure) -> Array:
        """Return the whitened residual [R] at theta(s); InputError where the motion doesn't excite a column."""
        values, _, equations = self.problem.linear(structure)
        return self.problem.noise.whiten(equations.torque - equations.phi @ values)


def _cost(search: Projection | Whole, structure: Structure) -> float:
    """Return the squared error at theta(s); inf where the motion doesn't excite a column."""
    try:
        return float(np.sum(search.residual(structure) ** 2))
    except InputError:
        return float("inf")


@dataclass(frozen=True)
class Estimator:
    """How parameters are estimated: what it is, whether rows are weighted by their noise, what follows the solution."""

    meaning: str
    weighted: bool
    finish: Callable[[Problem, Solution], Solution] | None = None


ESTIMATORS: dict[str, Estimator] = {
    "ls": Estimator("ordinary least squares (eq. 10)", False),
    "wls": Estimator("least squares weighted by the noise (eq. 7)", True),
    "ml": Estimator("maximum likelihood of parameters and trajectory together (eqs. 3 to 6)", True, maximum_likelihood),
    "iv": Estimator("instrumental variables, the model's own motion as instrument", True, instrumental_variables),
}


def solve(measurements: Sequence[Measurement], structure: Structure, estimator: str) -> Solution:
    """Return all parameters of a structure, searched from its inner parameters' grids."""
    _refuse_hidden(measurements, structure)
    problem: Problem | None = Problem(measurements, structure, weighted=ESTIMATORS[estimator].weighted)
    best: _Solved | None = None
    others: list[tuple[int, _Solved]] = []
    while problem is not None:
        used = problem
        searched = _with_scales(used, structure)
        if structure.scaled:
            used = used.weighed_anew(searched)
            searched = _with_scales(used, searched)
        if len(structure.inner) > len(structure.scaled):
            best, others = _best_forms(used, _refine(used, _scan(used, searched)))
            searched = _with_scales(used, best.structure)
        values, _, equations = used.linear(searched)
        problem = used.beside(values, equations)
    finish, found = ESTIMATORS[estimator].finish, solution(used, searched, values, equations)
    forms = [] if best is None else [_compared(used, best, index, one) for index, one in others]
    told = tuple(form for form in forms if form is not None)
    return replace(found if finish is None else finish(used, found), other_forms=told)


def _with_scales(problem: Problem, structure: Structure) -> Structure:
    """Return a structure at its most likely torque scales, by Gauss-Newton on theta and ln a, ln a ~ N(0, SPREAD^2)."""
    joints = structure.scaled
    if not joints:
        return structure
    theta, _, equations = problem.linear(structure)
    scales = structure.scales
    arm = structure.through_links
    alone = equations.phi[:, arm] / scales[equations.joint][:, None]
    own = equations.phi[:, ~arm]
    places = np.array(joints)
    mine = equations.joint[:, None] == places
    for _ in range(_ROUNDS):
        factor = scales[equations.joint]
        links = factor * (alone @ theta[arm])
        jacobian = np.hstack([factor[:, None] * alone, own, links[:, None] * mine])
        residual = equations.torque - links - own @ theta[~arm]
        white, right = problem.noise.weigh(jacobian), problem.noise.weigh(residual)
        step = held_softly(white, right, -np.log(scales[places]), SPREAD)
        change = np.clip(step[len(theta) :], -_STEP, _STEP)
        theta[arm] += step[: alone.shape[1]]
        theta[~arm] += step[alone.shape[1] : len(theta)]
        scales[places] *= np.exp(change)
        if np.abs(change).max() < _SETTLED:
            break
    effects = [
        effect.at({"scale": float(np.clip(scales[effect.joint], effect.inner[0].lower, effect.inner[0].upper))})
        if isinstance(effect, TorqueScale)
        else effect
        for effect in structure.effects
    ]
    return replace(structure, effects=tuple(effects))


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
        before, after = structure.effects[:index], structure.effects[index + 1 :]
        trials = [replace(structure, effects=(*before, effect.at(setting), *after)) for setting in settings]
        left = Projection.of(problem, structure, [effect.label])
        structure = min(trials, key=partial(_cost, left))
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


@dataclass(frozen=True)
class _Solved:
    """A structure at theta(s) [p], its equations, and the whitened squared error of each of their rows [R]."""

    structure: Structure
    values: Array
    equations: Equations
    left: Array

    @classmethod
    def of(cls, problem: Problem, structure: Structure) -> _Solved:
        values, _, equations = problem.linear(structure)
        white = problem.noise.whiten(equations.torque - equations.phi @ values)
        return cls(structure, values, equations, np.asarray(equations.independent * white**2))


def _best_forms(problem: Problem, structure: Structure) -> tuple[_Solved, list[tuple[int, _Solved]]]:
    """Return a structure with every effect in the form that leaves least, its inner parameters refined, and the same in
    each other form of one effect that the motion excites, by the effect's number.
    """
    mine, numbers = _Solved.of(problem, structure), range(len(structure.effects))
    while True:
        others = [(k, one) for k in numbers for one in _other_forms(problem, mine, k)]
        best = min((one for _, one in others), key=lambda one: one.left.sum(), default=mine)
        if best.left.sum() >= (1.0 - _LESS) * mine.left.sum():
            return mine, others
        again = _Solved.of(problem, _refine(problem, best.structure))
        mine = min(best, again, key=lambda one: one.left.sum())


def _other_forms(problem: Problem, mine: _Solved, index: int) -> list[_Solved]:
    """Return a structure with one of its effects in each other form that the motion excites, the best of the grid
    refined; of a ripple, whose lines are apart, none.
    """
    structure, effect = mine.structure, mine.structure.effects[index]
    names = [inner.name for inner in effect.inner if not inner.continuous]
    if not names or isinstance(effect, TorqueRipple):
        return []
    reached = joined([measured.motion for measured in problem.measurements])
    forms: dict[tuple[float, ...], list[Structure]] = {}
    for setting in effect.settings(reached):
        effects = (*structure.effects[:index], effect.at(setting), *structure.effects[index + 1 :])
        forms.setdefault(tuple(setting[name] for name in names), []).append(replace(structure, effects=effects))
    forms.pop(tuple(effect.setting[name] for name in names), None)
    projected = Projection.of(problem, structure, [effect.label], mine.values)
    best = [min(trials, key=partial(_cost, projected)) for trials in forms.values()]
    out = []
    for one in best:
        try:
            out.append(_Solved.of(problem, _refine(problem, one, [index], mine.values)))
        except InputError:  # the motion doesn't excite a column
            continue
    return out


def _compared(problem: Problem, mine: _Solved, index: int, other: _Solved) -> OtherForm | None:
    """Return what a structure with one effect in another form is, beside the one that leaves least; None where it
    leaves far more, or the motion does not tell its inner parameters.
    """
    effect = other.structure.effects[index]
    rows = slice(None) if effect.whole else mine.equations.joint == effect.joint
    unit = max(1.0, float(np.sum(mine.left[rows]) / np.sum(mine.equations.independent[rows])))
    more = float(np.sum(other.left) - np.sum(mine.left)) / unit
    if more > _FAR:
        return None
    try:
        found = solution(problem, other.structure, other.values, other.equations)
    except InputError:
        return None
    words = ", ".join(f"{inner.name} {effect.setting[inner.name]:.3g}" for inner in effect.inner)
    return OtherForm(effect, words, more, found.values, found.covariance)


def _refine(
    problem: Problem, structure: Structure, some: Collection[int] | None = None, near: Array | None = None
) -> Structure:
    """Refine continuous inner parameters of some effects, by number (None: of all), by bounded least squares on the
    projected residual; near: as `Projection.of` takes it.
    """
    from scipy.optimize import least_squares

    lower, upper, free = inner_bounds(structure)
    numbers = range(len(structure.effects)) if some is None else some
    effects = [structure.effects[k] for k in numbers if _searched(structure.effects[k])]
    free &= [effect in effects for effect in structure.effects for _ in effect.inner]
    if not free.any():
        return structure
    settings = structure.settings.copy()
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
    left = Projection.of(problem, structure, [effect.label for effect in effects], near)

    def rest(x: Array) -> Array:
        """Return the projected residual; where the motion no longer meets a column, as if nothing were explained."""
        try:
            return left.residual(at(x))
        except InputError:
            return problem.noise.whiten(problem.equations(structure, None).torque)

    found = least_squares(rest, start, bounds=(0.0, 1.0), diff_step=STEP, max_nfev=_MOST_STEPS, xtol=1e-5, ftol=1e-7)
    return at(found.x)
