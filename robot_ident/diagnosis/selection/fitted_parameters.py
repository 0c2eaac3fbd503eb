"""The parameters of named effects in a fit of the model with all of them, and whether they differ from zero: their
sigmas hold whichever form an effect has, the test is of the form that fits best.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.effects import Effect
from robot_ident.estimation.problem import Solution

TWO_SIGMA = 0.0455
"""Probability that a value of zero is estimated more than two standard deviations off."""


@dataclass(frozen=True)
class Fitted:
    """An effect's parameters, which of them is the least certain to differ from zero, and the probability that data of
    one which is zero give as large a value.
    """

    parameters: tuple[Estimate, ...]
    least: Estimate
    chance: float


def known_parameters(solution: Solution) -> Mapping[str, Fitted]:
    """Return by label the parameters of every effect of a solution, without the coefficients that others hold too."""
    model, spread, out = solution.structure, np.sqrt(np.diag(solution.whichever_form().covariance)), {}
    first = len(model.parameters)
    for effect, own in model.placed:
        inner = np.arange(first, first + len(effect.inner))
        first += len(effect.inner)
        spread[[k for k, one in zip(inner, effect.inner, strict=True) if one.at_bound(effect.setting[one.name])]] = 0.0
        places = [*range(own.start, own.stop), *inner]
        names = (*effect.parameter_names(), *effect.inner_names())
        units = (*effect.parameter_units(), *effect.inner_units())
        found = tuple(
            Estimate(name, float(solution.values[k]), float(spread[k]), unit)
            for name, k, unit in zip(names, places, units, strict=True)
        )
        if found:
            out[effect.label] = _fitted(effect, found, solution, own)
    return out


def _fitted(effect: Effect, found: tuple[Estimate, ...], solution: Solution, own: slice) -> Fitted:
    """Judge the linear parameters together (Wald's test), and each one inside a column that defines the effect."""
    from scipy.special import chdtrc

    values, count = solution.values[own], len(effect.coefficients)
    chances = {}
    if count:
        square = float(values @ np.linalg.pinv(solution.covariance[own, own], hermitian=True) @ values)
        chances[found[0]] = float(chdtrc(count, square))
    for one, inner in zip(found[count:], effect.inner, strict=True):
        if inner.defining and one.std > 0.0:
            chances[one] = float(chdtrc(1, (one.value / one.std) ** 2))
    least = max(chances, key=lambda one: chances[one], default=found[0])
    return Fitted(found, least, chances.get(least, 0.0))
