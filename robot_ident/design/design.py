"""Designs the excitation that tells most about a robot's parameters within its limits."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from robot_ident.design.criteria import PERIODS
from robot_ident.design.family import SIGN_WIDTH, Family, Setting, family_of
from robot_ident.design.local_search import Found
from robot_ident.design.multi_start import STARTS, Progress, Run, fallback, nothing_found, search
from robot_ident.design.program import smooth_sign
from robot_ident.design.target import Target
from robot_ident.errors import InputError, did_you_mean
from robot_ident.limits.certifier import Margins, certify, worst_of
from robot_ident.limits.feasibility import allowed_poses, require_limits
from robot_ident.limits.torque_bound import TorqueModel
from robot_ident.model.expressions import columns_function, slopes_function
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation

__all__ = ["CRITERIA", "DesignResult", "Progress", "design"]

CRITERIA = ("d-optimal", "condition", "crlb")
FEW_SEARCHES = 3  # below, a time limit was too short for a good motion
_FINISH = 1.2  # s left for the exact verdict at the end, or
_SLOWER = 2.5  # times what one of a random motion took: the best touches limits, and the machine may have more to do


@dataclass(frozen=True)
class DesignResult:
    """Excitations with their exact verdict: criteria of all together (and of a prior), standard deviations [p], margins
    (of all together and of each), and the best cost over time.
    """

    excitations: tuple[Excitation, ...]
    log10_det_covariance: float
    condition_number: float
    sigma: Array
    parameters: tuple[str, ...]
    margins: Margins
    margins_of_each: tuple[Margins, ...]
    seconds: float
    history: tuple[tuple[float, float], ...]
    notes: tuple[str, ...] = ()
    interrupted: bool = False

    @property
    def excitation(self) -> Excitation:
        """The first of them."""
        return self.excitations[0]


def design(
    robot: Robot,
    *,
    criterion: str = "d-optimal",
    harmonics: int | None = None,
    base_frequency: float = 0.1,
    sample_rate: float = 150.0,
    effects: Sequence[str] = (),
    target: Target | None = None,
    prior: Array | None = None,
    trajectories: int = 1,
    symmetric: bool = False,
    bandwidth: tuple[float, float] | None = None,
    periods: int = PERIODS,
    starts: int | None = None,
    time_limit: float | None = None,
    deadline: float | None = None,
    seed: int = 0,
    determinant_floor: float | None = None,
    start: Excitation | None = None,
    workers: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    cancel: Callable[[], bool] | None = None,
) -> DesignResult:
    """Return the best certified excitations that a multi-start search finds (Swevers et al. 1997, sections III, IV-B).

    criterion: `d-optimal` (determinant of the covariance), `condition` (condition number; with log10 of the determinant
    no larger than `determinant_floor`, by default that of the best of 400 random motions, the same for every seed) or
    `crlb` (determinant of the Cramer-Rao bound with noise on positions too, eq. 6, at the estimate of a model).
    effects: `name@joint`, beyond the robot's known ones. target: a model's columns at its estimates, in place of the
    robot and its effects. prior [p, p]: information that earlier recordings gave about those parameters. trajectories:
    so many motions designed together, for the sum of their information. symmetric: q(-t) = q(t). bandwidth (lowest,
    highest) Hz: only harmonics inside, at most `harmonics` (5) of them, spread evenly.

    time_limit [s] from now, or deadline on time.monotonic(); what is found before it is kept. starts: cold starts (12);
    start: a motion of the same harmonics from which one motion is searched for too, and a quarter of the cold starts;
    with a time limit and no number of them the search goes on, from new starts too, until it gains nothing more.
    Without a time limit the result depends on the seed alone. Ctrl-C ends the search and keeps the best so far. Raises
    InputError when limits are missing or can't be met together.
    """
    if criterion not in CRITERIA:
        raise InputError(f"unknown criterion {criterion!r}{did_you_mean(criterion, CRITERIA)}")
    for name, value in (("harmonics", harmonics), ("starts", starts), ("trajectories", trajectories)):
        if value is not None and value < 1:
            raise InputError(f"{name} = {value}: at least one is needed")
    family = family_of(base_frequency, sample_rate, harmonics, bandwidth, symmetric)
    require_limits(robot)
    target = target or Target.of_robot(robot, effects, periods)
    if criterion == "crlb" and not target.estimated:
        raise InputError(
            "criterion crlb depends on the parameters: it needs a first estimate (--model model.yaml);"
            " design by condition or d-optimal, record and identify first"
        )
    if prior is not None and np.shape(prior) != (len(target.structure.parameters),) * 2:
        raise InputError(f"prior: information about the {len(target.structure.parameters)} parameters was expected")
    started = time.monotonic()
    limit = min(started + (time_limit or np.inf), deadline or np.inf)
    run = Run(started, limit - _FINISH, workers, progress, cancel)
    setting = replace(_setting(target, family, criterion), prior=prior)
    if np.isfinite(limit):
        run.deadline = limit - max(_FINISH, _SLOWER * trajectories * _verdict_seconds(target, setting, seed))
    known = None if start is None else _coefficients(start, family)
    found = search(run, setting, trajectories, starts, seed, determinant_floor, known)
    if not found:
        raise nothing_found(run, setting, determinant_floor)
    asked: dict[str, Any] = {
        "base_frequency": base_frequency,
        "harmonics": len(family.orders),
        "sample_rate": sample_rate,
        "effects": list(effects),
        "starts": starts or STARTS,
        "time_limit": time_limit or (round(limit - started, 1) if np.isfinite(limit) else None),
        "seed": seed,
    }
    if trajectories != 1:
        asked["trajectories"] = trajectories
    if symmetric:
        asked["symmetric"] = symmetric
    if bandwidth is not None:
        asked["bandwidth"] = list(bandwidth)
    try:
        return _verdict(run, found, target, setting, asked)
    except KeyboardInterrupt:  # what is found is kept; who presses again means it
        run.interrupted = True
        return _verdict(run, found, target, setting, asked)


def _verdict_seconds(target: Target, setting: Setting, seed: int) -> float:
    """Return how long a motion's verdict takes on this machine now [s]; 0 where no random motion is certified."""
    first = fallback(pickle.dumps(setting), seed)
    if first is None:
        return 0.0
    began = time.monotonic()
    excitation = setting.family.excitation(target.robot, first.coefficients)
    certify(excitation, target.robot)
    target.judge([excitation], bound=setting.criterion == "crlb", prior=setting.prior)
    return time.monotonic() - began


def _coefficients(start: Excitation, family: Family) -> Array:
    """Return the coefficients [1 + 2 L, n] of a motion; InputError where it is of another family."""
    series = start.series
    if (series.base_frequency, series.harmonics) != (family.base_frequency, family.harmonics):
        raise InputError(
            f"the motion to start from has {series.harmonics} harmonics of {series.base_frequency:g} Hz, not"
            f" {family.harmonics} of {family.base_frequency:g} Hz"
        )
    return np.vstack([series.q0, series.a.T, series.b.T])


def _setting(target: Target, family: Family, criterion: str) -> Setting:
    robot, structure, values = target.robot, target.structure, target.values
    sign = smooth_sign(SIGN_WIDTH * family.reachable_speed(robot))
    torque = TorqueModel(robot)
    limited = torque.limited_joints()
    differentiable = all(effect.symbolic for effect in structure.effects)
    bound: dict[str, Any] = {}
    if criterion == "crlb":
        assert values is not None
        bound = {
            "slopes": slopes_function(structure, sign, values),
            "exact_slopes": slopes_function(structure, None, values),
            "position_variances": target.position_variances,
        }
    return Setting(
        robot=robot,
        family=family,
        structure=structure,
        values=values,
        smooth=columns_function(structure, sign, values),
        exact=columns_function(structure, None, values) if differentiable else None,
        variances=target.variances,
        criterion=criterion,
        poses=allowed_poses(robot),
        torque=torque.function(sign) if limited else None,
        torque_joints=limited,
        **bound,
    )


def _verdict(run: Run, found: Sequence[Found], target: Target, setting: Setting, asked: dict[str, Any]) -> DesignResult:
    """Return the trajectories with their exact criteria, certified anew from their coefficients as they are written."""
    robot, criterion = target.robot, setting.criterion
    plain = [setting.family.excitation(robot, one.coefficients) for one in found]
    values = target.judge(plain, bound=criterion == "crlb", prior=setting.prior)
    margins = tuple(certify(excitation, robot) for excitation in plain)
    for one in margins:
        if not one.kept:  # every candidate was certified, so this is a bug, never a result
            raise AssertionError(f"a trajectory that breaks a limit was kept: {one.violations[0]}")
    achieved: dict[str, Any] = {
        "log10_det_covariance": values.log10_det_covariance,
        "condition_number": values.condition_number,
        "periods": target.periods,
        "parameters": len(target.structure.names),
        "effects": list(target.structure.labels),
    }
    if setting.prior is not None:
        achieved["with_prior"] = True
    notes = [*target.notes]
    if asked["time_limit"] is not None and run.done < FEW_SEARCHES * len(plain):
        notes.append("hardly a search ended within the time limit: more time would give a far better motion")
    if notes:
        achieved["notes"] = notes
    limits = robot.limits
    kept = {
        "position": np.column_stack([limits.lower, limits.upper]).tolist(),
        "velocity": limits.velocity.tolist(),
        "acceleration": limits.acceleration.tolist(),
        "workspace": [rule.text for rule in robot.workspace],
    }
    reproduce = {"robot": robot.name, "criterion": criterion} | asked | {"searches": run.done} | _versions()
    excitations = [
        replace(
            excitation,
            criterion=criterion,
            achieved=achieved | ({"motion": k, "of": len(plain)} if len(plain) > 1 else {}),
            limits=kept | {"tightest": str(one.tightest)},
            reproduce=reproduce,
        )
        for k, (excitation, one) in enumerate(zip(plain, margins, strict=True), 1)
    ]
    return DesignResult(
        excitations=tuple(excitations),
        log10_det_covariance=values.log10_det_covariance,
        condition_number=values.condition_number,
        sigma=values.sigma,
        parameters=target.structure.names,
        margins=replace(worst_of(margins), notes=()),
        margins_of_each=margins,
        seconds=time.monotonic() - run.started,
        history=tuple(run.history),
        notes=tuple(notes),
        interrupted=run.interrupted,
    )


def _versions() -> dict[str, str]:
    out = {}
    for name in ("robot_ident", "casadi", "numpy"):
        try:
            out[f"{name}_version"] = version(name)
        except PackageNotFoundError:  # a checkout that isn't installed
            continue
    return out
