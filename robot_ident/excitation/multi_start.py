"""Searches from many starts: cold ones, hops from the best in rounds, and a last refinement, in parallel processes."""

from __future__ import annotations

import pickle
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_ident.excitation.cases import Case, fallback, run_case
from robot_ident.parallel import completed
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.excitation.search import Found

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
    best: Any = None
    done: int = 0
    longest: float = 0.0
    interrupted: bool = False
    label: str = ""

    def part(self, label: str, deadline: float) -> Run:
        """Return the state of one part of the design, which ends earlier."""
        return replace(self, label=label, deadline=deadline, history=[], best=None)

    def join(self, part: Run) -> None:
        """Take over what a part counted."""
        self.done, self.longest, self.interrupted = part.done, part.longest, part.interrupted

    def take_over(self, found: Found, recorded: bool) -> None:
        """Make what a part found the state of the whole; `recorded`: it counts in the history of the cost."""
        self.best = found
        if recorded and not (self.history and found.cost >= self.history[-1][1]):
            self.history.append((time.monotonic() - self.started, found.cost))

    def stopped(self, deadline: float) -> bool:
        """Return whether the user or the clock ends a stage."""
        if self.cancel is not None and self.cancel():
            self.interrupted = True
        return self.interrupted or time.monotonic() > deadline

    def take(self, found: Any) -> bool:
        """Keep a certified trajectory if it is the best; return whether it is."""
        if found is None or (self.best is not None and found.cost >= self.best.cost):
            return False
        self.best = found
        self.history.append((time.monotonic() - self.started, found.cost))
        return True

    def tell(self, phase: str, planned: int | None) -> None:
        """Report to the caller."""
        if self.progress is not None:
            det, condition = (self.best.log10_det, self.best.condition) if self.best else (float("inf"), float("inf"))
            phase = f"{self.label}, {phase}" if self.label else phase
            self.progress(Progress(phase, self.done, planned, det, condition, time.monotonic() - self.started))


def search_from_starts(
    run: Run, setting: Any, phase: str, cold: int, rounds: int | None, seed: int, deadline: float, warm: list[Array]
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

    cases = [Case(packed, "cold", (seed, 0, k), None, 0.0, close()) for k in range(cold)]
    cases += [Case(packed, "hop", (seed, 1, k), x, 0.0, close()) for k, x in enumerate(warm)]
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
        pool = _play(
            run,
            [Case(packed, "cold", (seed, 1000 + anew, k), None, 0.0, close()) for k in range(cold)],
            phase,
            None,
            close,
        )
    pool = sorted(left + pool, key=lambda entry: entry[0])
    cases = [Case(packed, "refine", (seed, -1, k), x, 0.0, deadline) for k, (_, x) in enumerate(pool[:2])]
    if not run.interrupted:
        _play(run, cases, phase, planned, lambda: deadline)
    return pool


def _hop(packed: bytes, key: tuple[int, ...], pool: list[tuple[float, Array]], deadline: float) -> Case:
    """Return a case that starts beside one of the best, five of eight times the very best, or at times anew."""
    rng = np.random.default_rng([abs(part) for part in key])
    place = key[-1] % HOPS
    if place == HOPS - 1:
        return Case(packed, "cold", key, None, 0.0, deadline)
    parent = 0 if place < 5 else min(place - 4, len(pool) - 1)
    width = float(rng.choice(_WIDTHS))
    return Case(packed, "hop", key, pool[parent][1], width, deadline)


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
