"""Parameters that a real arm can have: the nearest with every pseudo-inertia positive definite, and their uncertainty.

Base parameters are possible when some standard inertias give them. The nearest ones, in the metric of the estimate's
own covariance, solve a semidefinite program, which yields standard inertias for all links with them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.problem import Solution
from robot_ident.estimation.semidefinite import Nearest
from robot_ident.estimation.violations import NEAR, never_negative, separating, violations
from robot_ident.model.structure import Structure
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.signals.motion import Array

_DRAWS = 200  # of the noise, for the covariance; at least three a parameter


@dataclass(frozen=True)
class Consistent:
    """Physically consistent parameters.

    solution: with them in place of the estimate. inertias [10 n]: standard parameters of the links that give them,
    rotors [n] kg m^2. distance: sqrt of the rise of chi-square. violated: what the estimate broke. sharpened: by how
    much the largest change of a standard deviation, as a share of it, is that of `solution` below that of the data;
    None where the draws of the noise could not all be projected and the covariance is left as the data give it.
    """

    solution: Solution
    inertias: Array
    rotors: Array
    distance: float
    residual_rise: float
    violated: tuple[str, ...]
    sharpened: float | None

    @property
    def notes(self) -> tuple[str, ...]:
        """What happened, in a line or two."""
        if not self.violated:
            said: tuple[str, ...] = ("the parameters are physically possible as estimated",)
        else:
            said = (
                *(f"not physically possible as estimated: {one}" for one in self.violated),
                f"nearest possible parameters taken: {self.distance:.3g} standard deviations away (chi-square"
                f" +{self.distance**2:.3g}), mean squared residual {100 * self.residual_rise:+.2g} %",
            )
        if self.sharpened is None:
            return (*said, "sigma is that of the data alone, an upper bound: what is possible could not be counted in")
        if self.sharpened > 0.01:
            what = f"up to {100 * self.sharpened:.2g} % smaller than the data alone would give it"
            said = (*said, f"sigma counts in what is physically possible: {what}")
        return said

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        robot = self.solution.structure.robot
        return {
            "distance": self.distance,
            "residual_rise": self.residual_rise,
            "violated": list(self.violated),
            "covariance": "data" if self.sharpened is None else "constrained",
            "inertias": {
                name: dict(zip(STANDARD, map(float, row), strict=True))
                for name, row in zip(robot.joints, self.inertias.reshape(robot.n, 10), strict=True)
            },
            "rotor_inertia": dict(zip(robot.joints, map(float, self.rotors), strict=True)),
        }


def nearest_physical(found: Solution) -> Consistent:
    """Return the physically consistent parameters nearest to an estimate, in the metric of its covariance.

    Their own covariance is that of the projected estimate. Raises InputError where the solver doesn't converge.
    """
    structure = found.structure
    p = len(structure.parameters)
    estimate, covariance = found.values[:p], found.covariance[:p, :p]
    program = Nearest.of(structure, estimate, covariance, never_negative(structure))
    x, values = program.to(estimate)
    step = values - estimate
    rise = program.squared_distance(step)
    n = structure.robot.n
    equations = found.equations
    before = equations.torque - equations.phi @ estimate
    after = equations.torque - equations.phi @ values
    violated = violations(structure, estimate)
    if rise > NEAR and not violated:
        violated = (separating(structure, estimate, program.normal(step)),)
    projected = projected_covariance(program, values, found.covariance)
    return Consistent(
        solution=replace(
            found,
            values=np.concatenate([values, found.values[p:]]),
            covariance=found.covariance if projected is None else projected,
            chi_square=found.chi_square + rise,
        ),
        inertias=x[: 10 * n],
        rotors=x[10 * n : 11 * n] * structure.base.regrouping[:, 10 * n :].any(axis=0)
        + _free_rotors(structure, values),
        distance=float(np.sqrt(max(rise, 0.0))),
        residual_rise=float(np.sum(after**2) / np.sum(before**2) - 1.0),
        violated=violated,
        sharpened=None if projected is None else _sharpened(projected, found.covariance),
    )


def projected_covariance(program: Nearest, values: Array, covariance: Array) -> Array | None:
    """Return E[e e'] [p + r, p + r] of parameters projected on what is possible, were `values` [p] the true ones.

    Noise of the data's covariance [p + r, p + r] is drawn (always the same, with exactly that covariance), added to
    the possible parameters and projected again: a parametric bootstrap. It equals the data's covariance where nothing
    impossible is near, and a projection onto a convex set moves nothing away from the truth in the metric of that
    covariance, so that it is smaller on the whole. None where a draw can't be projected.
    """
    p, size = len(values), len(covariance)
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0, scale, 1.0)
    power, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(power, 0.0))
    draws = np.random.default_rng(1997).standard_normal((max(_DRAWS, 3 * size), size))
    draws = draws @ np.linalg.inv(np.linalg.cholesky(draws.T @ draws / len(draws))).T
    error = draws @ root.T * scale
    try:
        error[:, :p] = [program.to(values + one[:p])[1] - values for one in error]
    except InputError:
        return None
    return np.asarray(error.T @ error / len(error))


def _sharpened(projected: Array, covariance: Array) -> float:
    before = np.sqrt(np.diag(covariance))
    ratio = np.sqrt(np.diag(projected)) / np.where(before > 0, before, 1.0)
    return float(1.0 - np.min(ratio, where=before > 0, initial=1.0))


def _free_rotors(structure: Structure, values: Array) -> Array:
    out = np.zeros(structure.robot.n)
    for parameter, value in zip(structure.parameters, values, strict=True):
        if parameter.effect == "rotor_inertia" and parameter.joint is not None:
            out[structure.robot.joint_index(parameter.joint)] += value
    return out
