"""The parameters of named effects in a fit of the model with all of them, and whether they differ from zero: their
sigmas hold whichever form an effect has, the test is of the form that fits best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
            out[effect.label] = _fitted(effect, found, solution, places)
    return out


def _fitted(effect: Effect, found: tuple[Estimate, ...], solution: Solution, places: Sequence[int]) -> Fitted:
    """Judge the linear parameters and those inside a column that define the effect, together (Wald's test): what is
    known of both may be their product alone. Each of the latter must be larger than its standard deviation besides.
    """
    from scipy.special import chdtrc

    count = len(effect.coefficients)
    defining = [k for k, one in enumerate(effect.inner, count) if one.defining and found[k].std > 0.0]
    for k in defining:
        if abs(found[k].value) < found[k].std:
            return Fitted(found, found[k], 1.0)
    judged = [*range(count), *defining]
    if not judged:
        return Fitted(found, found[0], 0.0)
    at = [places[k] for k in judged]
    scale = np.sqrt(np.maximum(np.diag(solution.covariance)[at], 1e-300))
    z, together = solution.values[at] / scale, solution.covariance[np.ix_(at, at)] / np.outer(scale, scale)
    least = min(judged, key=lambda k: abs(found[k].value) / max(found[k].std, 1e-300))
    return Fitted(found, found[least], float(chdtrc(len(judged), z @ np.linalg.pinv(together, hermitian=True) @ z)))
