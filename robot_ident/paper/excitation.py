"""Section IV: both optimal trajectories, and the estimator on repeated noise (figs. 2 and 3, Table II)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.design.criteria import Evaluation, evaluate, noise_variances
from robot_ident.design.target import Target
from robot_ident.model.structure import Structure
from robot_ident.paper import printed
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.monte_carlo import MonteCarlo, montecarlo
from robot_ident.trajectories.excitation import Excitation

if TYPE_CHECKING:
    from robot_ident.design.bound import Bound

CRITERIA = ("condition", "d-optimal")
"""c1 and c2."""

FEWER = 3
"""Every third of 1500 samples: the 500 that the paper tries."""


@dataclass(frozen=True)
class Optimal:
    """The trajectory of one criterion: what it tells, and what 200 runs of the estimator gave on it.

    runs: at all samples of the period; fewer: at every third, 500 of 1500.
    """

    excitation: Excitation
    evaluation: Evaluation
    runs: MonteCarlo
    fewer: MonteCarlo


@dataclass(frozen=True)
class Excitations:
    """Section IV: the trajectories by their criterion, the bound that no trajectory passes, and the standard deviations
    [p] of the Cramer-Rao bound of the c2-optimal one, noise on positions included.
    """

    robot: Robot
    optimal: Mapping[str, Optimal]
    bound: Bound
    sigma_cr: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the 21 parameters."""
        return self.optimal["d-optimal"].runs.names

    def to_dict(self) -> dict[str, Any]:
        """Return all figures with the printed ones beside them."""
        out: dict[str, Any] = {"bound": self.bound.to_json(self.optimal["d-optimal"].evaluation.log10_det_covariance)}
        for criterion, one in self.optimal.items():
            out[criterion] = {
                "log10_det_covariance": one.evaluation.log10_det_covariance,
                "log10_det_covariance_printed": printed.LOG10_DET[criterion],
                "condition_number": one.evaluation.condition_number,
                "condition_number_printed": printed.CONDITION[criterion],
                "montecarlo": one.runs.to_dict(),
                "montecarlo_500_samples": one.fewer.to_dict(),
            }
        sigmas = {c: dict(zip(self.names, one.runs.sigma.tolist(), strict=True)) for c, one in self.optimal.items()}
        out["sigma"] = {**sigmas, "cramer_rao": dict(zip(self.names, self.sigma_cr.tolist(), strict=True))}
        out["sigma_printed"] = {c: dict(zip(self.names, printed.SIGMA[c], strict=True)) for c in self.optimal}
        return out


def excitations(robot: Robot, motions: Mapping[str, Excitation], *, seed: int, bound_seconds: float) -> Excitations:
    """Return section IV on a robot: the trajectories by their criterion, 200 runs each, the bound of c2.

    Noise variance: that of the average of 16 periods; joint angles are exact, as in the paper.
    """
    from robot_ident.design.bound import determinant_bound
    from robot_ident.design.family import family_of

    structure = Structure.build(robot)
    variance = noise_variances(robot)[0] / 16
    optimal = {}
    for number, criterion in enumerate(CRITERIA):
        excitation = motions[criterion]
        motion = excitation.samples()
        found = [
            montecarlo(one, structure, variance, runs=printed.RUNS, seed=seed + 10 * number + k)
            for k, one in enumerate((motion, motion[::FEWER]))
        ]
        optimal[criterion] = Optimal(excitation, evaluate(structure, excitation), *found)
    target = Target.of_robot(robot)
    best = motions["d-optimal"]
    family = family_of(best.base_frequency, best.sample_rate, best.harmonics, None, False)
    bound = determinant_bound(target, family, time_limit=bound_seconds)
    known = replace(target, values=structure.true_values(), estimated=True)
    return Excitations(robot, optimal, bound, known.judge([best], bound=True).sigma)


def sigma_share(found: Excitations, criterion: str) -> Array:
    """Return sigma over the printed one [p] of a criterion's trajectory."""
    return np.asarray(found.optimal[criterion].runs.sigma / np.array(printed.SIGMA[criterion]))
