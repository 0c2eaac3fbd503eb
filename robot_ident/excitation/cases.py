"""The searches of a design as independent cases that run in any process."""

from __future__ import annotations

import pickle
import time
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from robot_ident.signals.motion import Array

_ITERATIONS = 180


def _ahead() -> float:
    return time.time() - time.monotonic()


@dataclass(frozen=True)
class Case:
    """One search: `cold` from a random start, `hop` from beside `start`, `refine` from `start` itself.

    problem: the pickled setting. width: standard deviation of a hop in the scaled variables. key: seeds the case's
    own random numbers. deadline: on time.monotonic() of the machine that made the case; ahead: what the wall clock was
    ahead of that, since another machine's counts from another start.
    """

    problem: bytes
    kind: str
    key: tuple[int, ...]
    start: Array | None
    width: float
    deadline: float
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
    found: Any
    seconds: float


@lru_cache(maxsize=2)
def _problem(packed: bytes) -> Any:
    from robot_ident.excitation.problem import Problem

    return Problem(pickle.loads(packed))


def run_case(case: Case) -> Outcome:
    """Run one search."""
    from robot_ident.excitation import search

    began = time.monotonic()
    problem = _problem(case.problem)
    recorder = search.Recorder(problem, case.local_deadline)
    if recorder.expired():
        return Outcome(np.zeros(0), float("inf"), None, 0.0)
    rng = np.random.default_rng([abs(part) for part in case.key])
    if case.start is None:
        start = search.random_start(problem, rng, expired=recorder.expired)
    else:
        start = case.start + case.width * rng.normal(size=len(case.start))
    if case.kind == "refine":
        x = search.refine(problem, start, recorder)
    else:
        x = search.minimise(problem.coarse, start, recorder, iterations=_ITERATIONS)
    return Outcome(x, search.end_cost(problem, x), recorder.best, time.monotonic() - began)


@lru_cache(maxsize=2)
def fallback(packed: bytes, seed: int) -> Any:
    """Return a random trajectory, made small enough to be certified, or None."""
    from robot_ident.excitation import search

    problem = _problem(packed)
    recorder = search.Recorder(problem)
    coefficients = problem.coefficients(search.random_start(problem, np.random.default_rng(seed), draws=20))
    for _ in range(12):
        factor = search.shrink_factor(problem, coefficients)
        if factor > 0 and recorder.examine(search.shrunk(coefficients, factor)):
            break
        coefficients = search.shrunk(coefficients, 0.6)
    return recorder.best


def random_determinant(packed: bytes, draws: int) -> float:
    """Return log10 det of the covariance (smooth sign) of the best of random motions as large as the joints allow."""
    from robot_ident.excitation import search

    problem = _problem(packed)
    return float(problem.coarse.value(search.random_start(problem, np.random.default_rng(0), draws)))
