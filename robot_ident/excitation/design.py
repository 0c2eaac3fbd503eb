"""Designs the excitation that tells most about a robot's parameters within its limits."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.excitation.cases import excitation_of, random_determinant
from robot_ident.excitation.criteria import PERIODS, evaluate, noise_variances
from robot_ident.excitation.excitation import Excitation, check_sampling
from robot_ident.excitation.feasibility import allowed_poses, require_limits
from robot_ident.excitation.limits import Margins, certify
from robot_ident.excitation.multi_start import Progress, Run, search_from_starts
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.robot.robot import Robot

__all__ = ["CRITERIA", "DesignResult", "Progress", "design"]

CRITERIA = ("d-optimal", "condition")
MOST_HARMONICS = 60
FASTEST = 1e5  # Hz
STARTS = 12  # cold starts
COLD_PER_ROUND = 3  # as many rounds of hops as a third of the cold starts, where no time limit rules
FLOOR_DRAWS = 400  # without a floor given, the determinant may be a third of the best among as many random motions
FLOOR_OFFSET = -0.5
_FINISH = 1.2  # s for the exact verdict at the end


@dataclass(frozen=True)
class DesignResult:
    """An excitation with its exact verdict: criteria, standard deviations [p], margins, and the best cost over time."""

    excitation: Excitation
    log10_det_covariance: float
    condition_number: float
    sigma: Array
    parameters: tuple[str, ...]
    margins: Margins
    seconds: float
    history: tuple[tuple[float, float], ...]
    notes: tuple[str, ...] = ()
    interrupted: bool = False


def design(
    robot: Robot,
    *,
    criterion: str = "d-optimal",
    harmonics: int = 5,
    base_frequency: float = 0.1,
    sample_rate: float = 150.0,
    effects: Sequence[str] = (),
    periods: int = PERIODS,
    starts: int | None = None,
    time_limit: float | None = None,
    deadline: float | None = None,
    seed: int = 0,
    determinant_floor: float | None = None,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Callable[[], bool] | None = None,
) -> DesignResult:
    """Return the best certified excitation that a multi-start search finds (Swevers et al. 1997, section III and IV-B).

    criterion: `d-optimal` (determinant of the covariance) or `condition` (condition number; with log10 of the
    determinant no larger than `determinant_floor`, by default half a decade below that of the best of 400 random
    motions, the same for every seed). effects: `name@joint`, beyond the robot's known ones. time_limit [s] from now,
    or deadline on time.monotonic(); what is found before it is kept. starts: cold starts (12); with a time limit and
    no number of them the search goes on until it gains nothing more. Without a time limit the result depends on the
    seed alone. Ctrl-C ends the search and keeps the best so far. Raises InputError when limits are missing or can't
    be met together.
    """
    if criterion not in CRITERIA:
        raise InputError(f"unknown criterion {criterion!r}{did_you_mean(criterion, CRITERIA)}")
    if harmonics < 1 or (starts is not None and starts < 1):
        raise InputError(f"harmonics = {harmonics}, starts = {starts}: at least one of each is needed")
    check_sampling(base_frequency, sample_rate, harmonics)
    if harmonics > MOST_HARMONICS or sample_rate > FASTEST:
        raise InputError(
            f"harmonics = {harmonics}, sample_rate = {sample_rate:g} Hz:"
            f" at most {MOST_HARMONICS} and {FASTEST:g} Hz are designed for"
        )
    require_limits(robot)
    variances, notes = noise_variances(robot)
    structure = Structure.build(robot, effects)
    started = time.monotonic()
    limit = min(started + (time_limit or np.inf), deadline or np.inf)
    run = Run(started, limit - _FINISH, workers, progress, cancel)
    plan = {"base_frequency": base_frequency, "harmonics": harmonics, "sample_rate": sample_rate}
    setting = _setting(structure, variances / periods, plan)
    with _keeping_the_best(run):
        _search(run, setting, criterion, determinant_floor, starts, seed)
    if run.best is None:
        raise InputError(
            f"{robot.name}: no trajectory within the limits tells all {len(structure.names)} parameters apart"
        )
    seconds = round(limit - started, 1) if np.isfinite(limit) else None
    asked = {"effects": list(effects), "starts": starts or STARTS, "time_limit": seconds, "seed": seed}
    return _verdict(run, structure, criterion, plan | asked, periods, notes)


@contextmanager
def _keeping_the_best(run: Run) -> Iterator[None]:
    """Turn Ctrl-C into an early end once there is something to keep."""
    try:
        yield
    except KeyboardInterrupt:
        if run.best is None:
            raise
        run.interrupted = True


def _setting(structure: Structure, variances: Array, plan: dict[str, Any]) -> Any:
    from robot_ident.excitation.objective import smooth_regressor, smooth_sign
    from robot_ident.excitation.problem import SIGN_WIDTH, Setting, reachable_speed
    from robot_ident.excitation.torque import TorqueModel

    robot = structure.robot
    widths = SIGN_WIDTH * reachable_speed(robot, plan["base_frequency"])
    torque = TorqueModel(robot)
    limited = torque.limited_joints()
    return Setting(
        robot=robot,
        smooth=smooth_regressor(structure, widths),
        exact=structure.symbolic(),
        variances=variances,
        criterion="d-optimal",
        poses=allowed_poses(robot),
        torque=torque.function(smooth_sign(widths)) if limited else None,
        torque_joints=limited,
        **plan,
    )


def _search(run: Run, setting: Any, criterion: str, floor: float | None, starts: int | None, seed: int) -> None:
    cold = starts or STARTS
    rounds = cold // COLD_PER_ROUND if starts or np.isinf(run.deadline) else None
    if criterion == "d-optimal":
        search_from_starts(run, setting, "d-optimal", cold, rounds, seed, run.deadline, [])
        return
    left = run.deadline - time.monotonic()
    share = run.deadline if np.isinf(left) else time.monotonic() + 0.2 * left
    pool = search_from_starts(run, setting, "determinant first", 1, 0, seed, share, [])
    if run.best is None:
        return
    if floor is None:
        floor = random_determinant(pickle.dumps(setting), FLOOR_DRAWS) + FLOOR_OFFSET
    first = run.best
    run.best, run.history = None, []
    if first.log10_det <= floor:
        run.take(replace(first, cost=first.condition))
    setting = replace(setting, criterion="condition", floor=floor)
    search_from_starts(run, setting, "condition", cold, rounds, seed + 1, run.deadline, [x for _, x in pool[:2]])
    if run.best is None:
        raise InputError(
            f"no trajectory was found with log10 of the determinant below {floor:g}"
            f" (d-optimal reaches {first.log10_det:.2f})"
        )


def _verdict(
    run: Run, structure: Structure, criterion: str, options: dict[str, Any], periods: int, notes: tuple[str, ...]
) -> DesignResult:
    """Return the best trajectory with its exact criteria, certified anew from its coefficients as they are written."""
    robot = structure.robot
    excitation = excitation_of(run.best.coefficients, robot, options)
    values, margins = evaluate(structure, excitation, periods), certify(excitation, robot)
    if not margins.kept:  # every candidate was certified, so this is a bug, never a result
        raise AssertionError(f"a trajectory that breaks a limit was kept: {margins.violations[0]}")
    achieved: dict[str, Any] = {
        "log10_det_covariance": values.log10_det_covariance,
        "condition_number": values.condition_number,
        "periods": periods,
        "parameters": len(structure.names),
        "effects": list(structure.labels),
    }
    limits = robot.limits
    excitation = replace(
        excitation,
        criterion=criterion,
        achieved=achieved | ({"notes": list(notes)} if notes else {}),
        limits={
            "position": np.column_stack([limits.lower, limits.upper]).tolist(),
            "velocity": limits.velocity.tolist(),
            "acceleration": limits.acceleration.tolist(),
            "workspace": [rule.text for rule in robot.workspace],
            "tightest": str(margins.tightest),
        },
        reproduce={"robot": robot.name, "criterion": criterion} | options | {"searches": run.done} | _versions(),
    )
    return DesignResult(
        excitation=excitation,
        log10_det_covariance=values.log10_det_covariance,
        condition_number=values.condition_number,
        sigma=values.sigma,
        parameters=structure.names,
        margins=margins,
        seconds=time.monotonic() - run.started,
        history=tuple(run.history),
        notes=notes,
        interrupted=run.interrupted,
    )


def _versions() -> dict[str, str]:
    from importlib.metadata import PackageNotFoundError, version

    out = {}
    for name in ("robot_ident", "casadi", "numpy"):
        try:
            out[f"{name}_version"] = version(name)
        except PackageNotFoundError:  # a checkout that isn't installed
            continue
    return out
