"""Designs one motion, or several together for the best joint information: each in turn beside what the others tell."""

from __future__ import annotations

import pickle
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.cases import fallback, random_determinant
from robot_ident.excitation.feasibility import overloaded
from robot_ident.excitation.multi_start import Run, search_from_starts
from robot_ident.excitation.problem import Problem
from robot_ident.excitation.search import Found
from robot_ident.excitation.setting import Setting
from robot_ident.signals.motion import Array

STARTS = 12  # cold starts
COLD_PER_ROUND = 3  # as many rounds of hops as a third of the cold starts, where no time limit rules
FLOOR_DRAWS = 400  # without a floor given, the determinant may be that of the best among as many random motions
_TURNS = 2  # of every motion among several; more as long as there is time and they gain
_GAIN = 0.01
_FIRST = 0.2  # share of a search for the condition number that first lowers the determinant


def search(run: Run, setting: Setting, count: int, starts: int | None, seed: int, floor: float | None) -> list[Found]:
    """Return the best of `count` motions for the criterion of the sum of their information and the prior; empty where
    none was found.

    Each is searched with the others' information as prior: first one after the other, then in turns from where it
    stands. The cost of the set never rises. run.best is the last one found, with the values of the whole set.
    """
    if count == 1:
        with _keeping_the_best(run):
            search_one(run, setting, floor, starts, seed, run.deadline, [])
        return [] if run.best is None else [run.best]
    problem, found, told = Problem(setting), list[Found](), list[Array]()
    turn, gained = 0, True
    while turn < _TURNS or (gained and np.isfinite(run.deadline) and not run.stopped(run.deadline)):
        before = run.best.cost if turn else np.inf
        for k in range(count):
            if turn and run.stopped(run.deadline):
                return found
            stages = count * max(1, _TURNS - turn) - k
            here = replace(setting, prior=_sum(setting, [one for other, one in enumerate(told) if other != k]))
            whole = bool(turn) or k == count - 1  # the floor is that of the set
            asked = floor if whole else None
            try:
                best, held = _stage(
                    run, here, found[k] if turn else None, (k, count), stages, starts, seed, asked, turn
                )
            except KeyboardInterrupt:  # between two searches
                if not turn:
                    raise
                run.interrupted = True
                return found
            if best is None:
                return []
            floor = held if whole else floor
            found[k:] = [best, *found[k + 1 :]]
            told[k:] = [problem.information(best.coefficients), *told[k + 1 :]]
            run.take_over(best, recorded=len(found) == count)
        turn, gained = turn + 1, run.best.cost < before - _GAIN
    return found


def _stage(
    run: Run,
    setting: Setting,
    current: Found | None,
    place: tuple[int, int],
    stages: int,
    starts: int | None,
    seed: int,
    floor: float | None,
    turn: int,
) -> tuple[Found | None, float | None]:
    """Return the best motion beside the others of the prior, and the floor of the determinant that held."""
    k, count = place
    left = run.deadline - time.monotonic()
    until = time.monotonic() + left / stages if np.isfinite(left) else np.inf
    stage = run.part(f"motion {k + 1} of {count}", until)
    warm = []
    if current is not None:
        problem = Problem(replace(setting, floor=floor))
        stage.best = replace(current, cost=problem.cost(problem.evaluate(current.coefficients)))
        warm = [problem.variables(current.coefficients)]
    if run.interrupted:
        stage.take(fallback(pickle.dumps(setting), seed + k))
        return stage.best, floor
    with _keeping_the_best(stage):
        key = seed + 1000 * (turn * count + k)
        floor = search_one(stage, setting, floor, starts, key, until, warm)
    run.join(stage)
    return stage.best, floor


def search_one(
    run: Run, setting: Setting, floor: float | None, starts: int | None, seed: int, deadline: float, warm: list[Array]
) -> float | None:
    """Search for one motion, from `warm` variables too; run.best holds it. Return the floor of the determinant."""
    cold = starts or STARTS
    if warm:
        cold = max(1, cold // 4)
    rounds = cold // COLD_PER_ROUND if starts or np.isinf(deadline) else None
    if setting.criterion != "condition":
        search_from_starts(run, setting, setting.criterion, cold, rounds, seed, deadline, warm)
        return None
    if not warm:
        warm, floor = _determinant_first(run, setting, floor, seed, deadline)
        if floor is None:
            return None
    setting = replace(setting, floor=floor)
    search_from_starts(run, setting, "condition", cold, rounds, seed + 1, deadline, warm)
    return floor


def _determinant_first(
    run: Run, setting: Setting, floor: float | None, seed: int, deadline: float
) -> tuple[list[Array], float | None]:
    """Return variables of motions with a low determinant, to start from, and the floor; None where none was found."""
    left = deadline - time.monotonic()
    share = deadline if np.isinf(left) else time.monotonic() + _FIRST * left
    plain = replace(setting, criterion="d-optimal")
    pool = search_from_starts(run, plain, "determinant first", 1, 0, seed, share, [])
    first = run.best
    if first is None:
        return [], None
    if floor is None:
        floor = random_determinant(pickle.dumps(plain), FLOOR_DRAWS)
    run.best, run.history = None, []
    if first.log10_det <= floor:
        run.take(replace(first, cost=first.condition))
    return [x for _, x in pool[:2]], floor


def nothing_found(run: Run, setting: Setting, floor: float | None) -> InputError:
    """Return what to say where no motion was found."""
    robot = setting.robot.name
    heavy = overloaded(setting.robot)
    if heavy:
        return InputError(f"{setting.robot.source}: no pose can be held: {heavy} (by the masses of the URDF)")
    if time.monotonic() > run.deadline and run.done:
        return InputError(
            f"{robot}: none of {run.done} searches led to a trajectory that keeps the limits, and the time limit ended"
            " the others: wider limits, a lower --base-frequency, or more time (--time-limit)"
        )
    if time.monotonic() > run.deadline:
        floored = " and is no worse in the determinant than random ones" if setting.criterion == "condition" else ""
        return InputError(
            f"{robot}: the time limit ended the search before it found a trajectory that keeps the limits{floored}:"
            " give it more (--time-limit)"
        )
    if setting.criterion == "condition" and floor is not None:
        return InputError(f"{robot}: no trajectory was found with log10 of the determinant below {floor:g}")
    return InputError(f"{robot}: no trajectory within the limits tells all {setting.parameters} parameters apart")


def _sum(setting: Setting, parts: list[Array]) -> Array | None:
    known = [*parts] if setting.prior is None else [setting.prior, *parts]
    return np.sum(known, axis=0) if known else None


@contextmanager
def _keeping_the_best(run: Run) -> Iterator[None]:
    """Turn Ctrl-C into an early end once there is something to keep."""
    try:
        yield
    except KeyboardInterrupt:
        if run.best is None:
            raise
        run.interrupted = True
