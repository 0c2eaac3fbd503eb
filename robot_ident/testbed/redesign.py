"""Design, measurement and estimation in turn, until no better motion is found (Swevers et al. 1997, section III-B)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from robot_ident.design.criteria import PERIODS
from robot_ident.design.design import DesignResult, Progress, design
from robot_ident.design.target import Target
from robot_ident.estimation.identify import estimate
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording.process import process
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import Play
from robot_ident.trajectories.excitation import Excitation

ENOUGH = 0.02  # fall of the mean sigma below which a new motion is not worth a measurement
ROUNDS = 6  # redesigns at most


@dataclass(frozen=True)
class Round:
    """A motion, the model that maximum likelihood estimates from its measurement, and the Cramer-Rao bound there.

    log10_det_bound, sigma [p]: of the bound at this round's estimate (eq. 6). fall: by which share this motion lowers
    the geometric mean of the bound's sigmas against the motion before it, both at the estimate from which it was
    designed; 0 for the first motion.
    """

    excitation: Excitation
    model: Model
    log10_det_bound: float
    sigma: Array
    fall: float


@dataclass(frozen=True)
class Redesigned:
    """All rounds, the last design that was measured with its exact verdict, and the fall that the next motion would
    have brought; None where the user stopped its search.
    """

    rounds: tuple[Round, ...]
    last: DesignResult
    next_fall: float | None

    @property
    def converged(self) -> bool:
        """Whether the next motion would have brought less than the stop rule asks."""
        return self.next_fall is not None and self.next_fall < ENOUGH

    @property
    def in_words(self) -> str:
        """Why the iteration ended."""
        after = f"after {len(self.rounds)} measurement{'s' if len(self.rounds) > 1 else ''}"
        if self.next_fall is None:
            return f"stopped {after}"
        if not self.converged:
            return f"did not converge {after}: the mean sigma still falls by {100 * self.next_fall:.1f} %"
        return (
            f"converged {after}: the next trajectory would lower the mean sigma by"
            f" {100 * max(0.0, self.next_fall):.1f} %, less than the {100 * ENOUGH:g} % of the stop rule"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the rounds as plain values."""
        return {
            "converged": self.converged,
            "next_fall": self.next_fall,
            "rounds": [
                {
                    "criterion": one.excitation.criterion,
                    "log10_det_bound": one.log10_det_bound,
                    "sigma": dict(zip(one.model.structure.names, one.sigma.tolist(), strict=True)),
                    "fall": one.fall,
                }
                for one in self.rounds
            ],
        }


def redesign(
    robot: Robot,
    *,
    effects: Sequence[str] = (),
    harmonics: int | None = None,
    base_frequency: float = 0.1,
    sample_rate: float = 150.0,
    starts: int | None = None,
    time_limit: float | None = None,
    first: Excitation | None = None,
    seed: int = 0,
    progress: Callable[[int, Progress], None] | None = None,
) -> Redesigned:
    """Design by the condition number, measure the simulated robot, estimate, design by the Cramer-Rao bound at that
    estimate, measure again; stop where a new motion lowers the geometric mean of the sigmas by less than 2 %.

    starts, time_limit [s]: of each design. first: the motion to begin with, in place of one by the condition number.
    From the second on, a design searches from the motion before it too, and all from the same seed: chance in the
    search is no difference between rounds. Every measurement has noise of its own. Ctrl-C ends it with the rounds that
    are done. Raises InputError where the robot's files give no noise of its positions.
    """
    _ = Target.of_robot(robot, effects).position_variances  # what the bound needs, before hours of search

    def found_by(criterion: str, target: Target | None, number: int, start: Excitation | None) -> DesignResult:
        return design(
            robot,
            criterion=criterion,
            effects=effects,
            target=target,
            harmonics=harmonics,
            base_frequency=base_frequency,
            sample_rate=sample_rate,
            starts=starts,
            time_limit=time_limit,
            seed=seed,
            start=start,
            progress=None if progress is None else lambda state: progress(number, state),
        )

    last = None if first is not None else found_by("condition", None, 0, None)
    motion = first if last is None else last.excitation
    assert motion is not None
    done = [_measured(robot, motion, effects, seed, 0.0)]
    if last is not None and last.interrupted:
        return Redesigned(tuple(done), last, None)
    while True:
        target = Target.of_model(done[-1].model, robot=robot)
        best = found_by("crlb", target, len(done), done[-1].excitation if len(done) > 1 else None)
        if best.interrupted:
            return Redesigned(tuple(done), best if last is None else last, None)
        before = target.judge([done[-1].excitation], bound=True).log10_det_covariance
        p = len(target.structure.parameters)
        fall = 1.0 - 10.0 ** ((best.log10_det_covariance - before) / (2 * p))
        if fall < ENOUGH or len(done) > ROUNDS:
            return Redesigned(tuple(done), best if last is None else last, fall)
        last = best
        done.append(_measured(robot, best.excitation, effects, seed + len(done), fall))


def _measured(robot: Robot, excitation: Excitation, effects: Sequence[str], seed: int, fall: float) -> Round:
    """Measure the simulated robot on a motion and estimate by maximum likelihood."""
    play = Play.of(robot, plant_physics(robot, list(effects)), excitation.series, sample_rate=excitation.sample_rate)
    measured = process(play.record(PERIODS, seed=seed), robot)
    model = estimate([measured], Structure.build(robot, effects), estimator="ml")
    bound = Target.of_model(model, robot=robot).judge([excitation], bound=True)
    return Round(excitation, model, bound.log10_det_covariance, bound.sigma, fall)
