"""Searches from many starts, as independent cases that run in any process.

Cold ones, hops from the best in rounds, a last refinement; for one motion, or several in turn, each beside what the
others tell.
"""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from robot_ident.design.family import Setting
from robot_ident.design.local_search import (
    Found,
    Recorder,
    end_cost,
    minimise,
    random_start,
    refine,
    shrink_factor,
    shrunk,
)
from robot_ident.design.program import Problem
from robot_ident.errors import InputError
from robot_ident.limits.feasibility import overloaded
from robot_ident.parallel import completed
from robot_ident.signals.motion import Array

_ITERATIONS = 180


def _ahead() -> float:
    return time.time() - time.monotonic()


@dataclass(frozen=True)
class Case:
    """One search from a random start or, by `width`, beside `start` [x]; last: on the fine grid.

    problem: the pickled setting. width: standard deviation of a hop in the scaled variables. key: seeds the case's
    own random numbers. deadline: on time.monotonic() of the machine that made the case; ahead: what the wall clock was
    ahead of that, since another machine's counts from another start.
    """

    problem: bytes
    key: tuple[int, ...]
    deadline: float
    start: Array | None = None
    width: float = 0.0
    last: bool = False
    ahead: float = field(default_factory=_ahead)

    @property
    def local_deadline(self) -> float:
        """The deadline on time.monotonic() of the machine that runs the case."""
        return self.deadline + self.ahead - _ahead()


@dataclass(frozen=True)
class Outcome:
    """What a search ends with: its variables, their exact cost (inf: infeasible), the best certified trajectory."""

    variables: Array
    cost: float
    found: Found | None
    seconds: float


@lru_cache(maxsize=2)
def _problem(packed: bytes) -> Problem:
    return Problem(pickle.loads(packed))


def run_case(case: Case) -> Outcome:
    """Run one search."""
    began = time.monotonic()
    problem = _problem(case.problem)
    recorder = Recorder(problem, case.local_deadline)
    if recorder.expired():
        return Outcome(np.zeros(0), float("inf"), None, 0.0)
    rng = np.random.default_rng([abs(part) for part in case.key])
    if case.start is None:
        start = random_start(problem, rng, expired=recorder.expired)
    else:
        start = case.start + case.width * rng.normal(size=len(case.start))
    if case.last:
        x = refine(problem, start, recorder)
    else:
        x = minimise(problem.coarse, start, recorder, iterations=_ITERATIONS)
    return Outcome(x, end_cost(problem, x), recorder.best, time.monotonic() - began)


@lru_cache(maxsize=2)
def fallback(packed: bytes, seed: int) -> Found | None:
    """Return a random trajectory, made small enough to be certified, or None."""
    problem = _problem(packed)
    recorder = Recorder(problem)
    coefficients = problem.coefficients(random_start(problem, np.random.default_rng(seed), draws=20))
    for _ in range(12):
        factor = shrink_factor(problem, coefficients)
        if factor > 0 and recorder.examine(shrunk(coefficients, factor)):
            break
        coefficients = shrunk(coefficients, 0.6)
    return recorder.best


def random_determinant(packed: bytes, draws: int) -> float:
    """Return log10 det of the covariance (smooth sign) of the best of random motions as large as the joints allow."""
    problem = _problem(packed)
    return float(problem.coarse.value(random_start(problem, np.random.default_rng(0), draws)))


HOPS = 8  # searches a round
_STALE = 4  # rounds without gain after which a search begins anew or ends
_ANEW = 3  # times that a search with a time limit begins anew
_GAIN = 0.003
_WIDTHS = (0.05, 0.1, 0.2, 0.3, 0.4)  # of hops: standard deviation in the scaled variables


class Progress(NamedTuple):
    """How a design stands: what runs, searches done and planned (if known), the best certified values, seconds."""

    phase: str
    done: int
    planned: int | None
    log10_det_covariance: float
    condition_number: float
    seconds: float


@dataclass
class Run:
    """The state of a design: the clock, what was found, whom to tell."""

    started: float
    deadline: float
    workers: int | None
    progress: Callable[[Progress], None] | None
    cancel: Callable[[], bool] | None
    history: list[tuple[float, float]] = field(default_factory=list)
    best: Found | None = None
    done: int = 0
    longest: float = 0.0
    interrupted: bool = False
    label: str = ""

    def stopped(self, deadline: float) -> bool:
        """Return whether the user or the clock ends a stage."""
        if self.cancel is not None and self.cancel():
            self.interrupted = True
        return self.interrupted or time.monotonic() > deadline

    def take(self, found: Found | None) -> None:
        """Keep a certified trajectory if it is the best."""
        if found is not None and (self.best is None or found.cost < self.best.cost):
            self.best = found
            self.history.append((time.monotonic() - self.started, found.cost))

    def tell(self, phase: str, planned: int | None) -> None:
        """Report to the caller."""
        if self.progress is not None:
            det, condition = (self.best.log10_det, self.best.condition) if self.best else (float("inf"), float("inf"))
            phase = f"{self.label}, {phase}" if self.label else phase
            self.progress(Progress(phase, self.done, planned, det, condition, time.monotonic() - self.started))


def search_from_starts(
    run: Run, setting: Setting, phase: str, cold: int, rounds: int | None, seed: int, deadline: float, warm: list[Array]
) -> list[tuple[float, Array]]:
    """Search from cold starts, hop in rounds, refine; return the pool (cost, variables), best first.

    Which cases a round holds depends on the seed and on earlier rounds only, whatever the number of workers.
    """
    packed = pickle.dumps(setting)
    run.take(fallback(packed, seed))
    run.tell(phase, None)
    planned = None if rounds is None else run.done + cold + len(warm) + rounds * HOPS + 2
    total = deadline - time.monotonic()

    def close() -> float:
        return deadline - min(0.35 * total, 2.5 * run.longest) if np.isfinite(deadline) else deadline

    cases = [Case(packed, (seed, 0, k), close()) for k in range(cold)]
    cases += [Case(packed, (seed, 1, k), close(), x) for k, x in enumerate(warm)]
    pool = _play(run, cases, phase, planned, close)
    left: list[tuple[float, Array]] = []
    stale, turn, anew = 0, 0, 0
    while pool and (rounds is None or turn < rounds) and not run.stopped(close()):
        before = pool[0][0]
        turn += 1
        cases = [_hop(packed, (seed, 1 + turn, k), pool, close()) for k in range(HOPS)]
        pool = sorted(pool + _play(run, cases, phase, planned, close), key=lambda entry: entry[0])[:10]
        stale = 0 if pool[0][0] < before - _GAIN else stale + 1
        if stale < _STALE:
            continue
        if rounds is not None or anew == _ANEW:
            break
        stale, anew, left = 0, anew + 1, left + pool[:2]  # hops lead no further from here; elsewhere they may
        cases = [Case(packed, (seed, 1000 + anew, k), close()) for k in range(cold)]
        pool = _play(run, cases, phase, None, close)
    pool = sorted(left + pool, key=lambda entry: entry[0])
    cases = [Case(packed, (seed, -1, k), deadline, x, last=True) for k, (_, x) in enumerate(pool[:2])]
    if not run.interrupted:
        _play(run, cases, phase, planned, lambda: deadline)
    return pool


def _hop(packed: bytes, key: tuple[int, ...], pool: list[tuple[float, Array]], deadline: float) -> Case:
    """Return a case that starts beside one of the best, five of eight times the very best, or at times anew."""
    rng = np.random.default_rng([abs(part) for part in key])
    place = key[-1] % HOPS
    if place == HOPS - 1:
        return Case(packed, key, deadline)
    parent = 0 if place < 5 else min(place - 4, len(pool) - 1)
    return Case(packed, key, deadline, pool[parent][1], width=float(rng.choice(_WIDTHS)))


def _play(
    run: Run, cases: Sequence[Case], phase: str, planned: int | None, close: Callable[[], float]
) -> list[tuple[float, Array]]:
    """Run cases in parallel; return (cost, variables) of those that ended well, best first."""
    ended: dict[int, tuple[float, Array]] = {}
    if run.stopped(close()):  # the processes alone take seconds to start
        return []
    with closing(completed(run_case, cases, run.workers)) as results:
        for index, outcome in results:
            run.done += 1
            run.longest = max(run.longest, outcome.seconds)
            run.take(outcome.found)
            if np.isfinite(outcome.cost):
                ended[index] = (outcome.cost, outcome.variables)
            run.tell(phase, planned)
            if run.stopped(close()):
                break
    return sorted((ended[index] for index in sorted(ended)), key=lambda entry: entry[0])


STARTS = 12  # cold starts
COLD_PER_ROUND = 3  # as many rounds of hops as a third of the cold starts, where no time limit rules
FLOOR_DRAWS = 400  # without a floor given, the determinant may be that of the best among as many random motions
_TURNS = 2  # of every motion among several; more as long as there is time and they gain
_ROUND_GAIN = 0.01
_FIRST = 0.2  # share of a search for the condition number that first lowers the determinant


def search(
    run: Run,
    setting: Setting,
    count: int,
    starts: int | None,
    seed: int,
    floor: float | None,
    known: Array | None = None,
) -> list[Found]:
    """Return the best of `count` motions for the criterion of the sum of their information and the prior; empty where
    none was found. known: coefficients [1 + 2 L, n] of a motion from which one motion is searched for too.

    Each is searched with the others' information as prior: first one after the other, then in turns from where it
    stands. The cost of the set never rises. run.best is the last one found, with the values of the whole set.
    """
    if count == 1:
        with _keeping_the_best(run):
            if known is not None and floor is None and setting.criterion == "condition":
                floor = random_determinant(pickle.dumps(replace(setting, criterion="d-optimal")), FLOOR_DRAWS)
            warm = [] if known is None else [_taken(run, Problem(replace(setting, floor=floor)), known)]
            search_one(run, setting, floor, starts, seed, warm)
        return [] if run.best is None else [run.best]
    problem, found, told = Problem(setting), list[Found](), list[Array]()
    turn, gained, cost = 0, True, np.inf
    while turn < _TURNS or (gained and np.isfinite(run.deadline) and not run.stopped(run.deadline)):
        before = cost
        for k in range(count):
            if turn and run.stopped(run.deadline):
                return found
            stages = count * max(1, _TURNS - turn) - k
            known_already = [*([] if setting.prior is None else [setting.prior]), *told[:k], *told[k + 1 :]]
            here = replace(setting, prior=np.sum(known_already, axis=0) if known_already else None)
            whole = bool(turn) or k == count - 1  # the floor is that of the set
            asked, current = floor if whole else None, found[k] if turn else None
            try:
                best, held = _stage(run, here, current, (k, count), stages, starts, seed, asked, turn)
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
            run.best, cost = best, best.cost
            if len(found) == count and not (run.history and cost >= run.history[-1][1]):
                run.history.append((time.monotonic() - run.started, cost))
        turn, gained = turn + 1, cost < before - _ROUND_GAIN
    return found


def _taken(run: Run, problem: Problem, known: Array) -> Array:
    """Return the variables of a known motion, which is the best so far where it is certified."""
    recorder = Recorder(problem)
    recorder.examine(known)
    run.take(recorder.best)
    return problem.variables(known)


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
    stage = replace(run, label=f"motion {k + 1} of {count}", deadline=until, history=[], best=None)
    warm = []
    if current is not None:
        problem = Problem(replace(setting, floor=floor))
        stage.best = replace(current, cost=problem.cost(problem.evaluate(current.coefficients)))
        warm = [problem.variables(current.coefficients)]
    if run.interrupted:
        stage.take(fallback(pickle.dumps(setting), seed + k))
        return stage.best, floor
    with _keeping_the_best(stage):
        floor = search_one(stage, setting, floor, starts, seed + 1000 * (turn * count + k), warm)
    run.done, run.longest, run.interrupted = stage.done, stage.longest, stage.interrupted
    return stage.best, floor


def search_one(
    run: Run, setting: Setting, floor: float | None, starts: int | None, seed: int, warm: list[Array]
) -> float | None:
    """Search for one motion, from `warm` variables too; run.best holds it. Return the floor of the determinant."""
    cold = starts or STARTS
    if warm:
        cold = max(1, cold // 4)
    rounds = cold // COLD_PER_ROUND if starts or np.isinf(run.deadline) else None
    if setting.criterion != "condition":
        search_from_starts(run, setting, setting.criterion, cold, rounds, seed, run.deadline, warm)
        return None
    if not warm:
        warm, floor = _determinant_first(run, setting, floor, seed)
        if floor is None:
            return None
    search_from_starts(run, replace(setting, floor=floor), "condition", cold, rounds, seed + 1, run.deadline, warm)
    return floor


def _determinant_first(run: Run, setting: Setting, floor: float | None, seed: int) -> tuple[list[Array], float | None]:
    """Return variables of motions with a low determinant, to start from, and the floor; None where none was found."""
    left = run.deadline - time.monotonic()
    share = run.deadline if np.isinf(left) else time.monotonic() + _FIRST * left
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
    condition = setting.criterion == "condition"
    if heavy := overloaded(setting.robot):
        return InputError(f"{setting.robot.source}: no pose can be held: {heavy} (by the masses of the URDF)")
    if time.monotonic() > run.deadline and run.done:
        words = (
            f"none of {run.done} searches led to a trajectory that keeps the limits, and the time limit ended the"
            " others: wider limits, a lower --base-frequency, or more time (--time-limit)"
        )
    elif time.monotonic() > run.deadline:
        floored = " and is no worse in the determinant than random ones" if condition else ""
        words = f"the time limit ended the search before it found a trajectory that keeps the limits{floored}:"
        words += " give it more (--time-limit)"
    elif condition and floor is not None:
        words = f"no trajectory was found with log10 of the determinant below {floor:g}"
    else:
        words = f"no trajectory within the limits tells all {setting.parameters} parameters apart"
    return InputError(f"{setting.robot.name}: {words}")


@contextmanager
def _keeping_the_best(run: Run) -> Iterator[None]:
    """Turn Ctrl-C into an early end once there is something to keep."""
    try:
        yield
    except KeyboardInterrupt:
        if run.best is None:
            raise
        run.interrupted = True
