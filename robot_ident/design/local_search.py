"""One local search: from coefficients to the best certified trajectory that it passes."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.design.program import Problem, Program
from robot_ident.parallel import nothing_swallowed
from robot_ident.signals.motion import Array

_STEPS: dict[str, dict[str, str]] = {  # how IPOPT steps, by what was measured to lead furthest in a given time
    "d-optimal": {"mehrotra_algorithm": "yes"},
    "crlb": {"mehrotra_algorithm": "yes"},
    "condition": {"mu_strategy": "adaptive"},
}
_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-4,
    "acceptable_tol": 1e-3,
    "acceptable_iter": 5,
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 6,
}
_STEP = 0.02  # gain of the smooth cost from which an iterate is looked at
_STRICT = 1e-9  # share of a limit that stays free, against rounding
_NEARLY = 0.97  # where a search on the coarse grid counts as feasible: share of the limits,
_SLIP = 0.01  # and distance by which a rule of distance is broken, m
_WORTHWHILE = 0.8  # iterates that would have to shrink further than this aren't repaired


@dataclass(frozen=True)
class Found:
    """A certified trajectory: coefficients [1 + 2 L, n], exact cost, log10 det of the covariance, condition number."""

    coefficients: Array
    cost: float
    log10_det: float
    condition: float


@dataclass
class Recorder:
    """Keeps the best certified trajectory among all iterates that it is shown."""

    problem: Problem
    deadline: float = float("inf")
    best: Found | None = None
    seen: float = float("inf")  # smallest estimate that has been looked at

    def offer(self, x: Array, estimate: float) -> None:
        """Look at variables x with the smooth cost `estimate`, unless they aren't likely to beat what was seen."""
        if not np.all(np.isfinite(x)) or not estimate < self.seen - _STEP:
            return
        coefficients = self.problem.coefficients(x)
        factor = shrink_factor(self.problem, coefficients)
        if factor < _WORTHWHILE:
            return
        estimate += self.problem.cost_of_shrinking(factor)
        if estimate < self.seen - _STEP and self.examine(shrunk(coefficients, factor)):
            self.seen = estimate

    def conclude(self, x: Array) -> None:
        """Examine the variables at which a search ends, and forget its estimates."""
        self.seen = float("inf")
        coefficients = self.problem.coefficients(x)
        if np.all(np.isfinite(x)) and (factor := shrink_factor(self.problem, coefficients)) > 0:
            self.examine(shrunk(coefficients, factor))

    def examine(self, coefficients: Array) -> bool:
        """Keep the coefficients if they are certified and the best so far; return whether they are certified."""
        for factor in (1.0, 0.998, 0.99, 0.97):
            candidate = shrunk(coefficients, factor)
            if self.problem.certifier.keeps(self.problem.excitation(candidate)):
                values = self.problem.evaluate(candidate)
                cost = self.problem.cost(values)
                if np.isfinite(cost) and (self.best is None or cost < self.best.cost):
                    self.best = Found(candidate, cost, *values)
                return True
        return False

    def expired(self) -> bool:
        """Whether the deadline (time.monotonic) has passed."""
        return time.monotonic() > self.deadline


def shrunk(coefficients: Array, factor: float) -> Array:
    """Return the motion about the same mean with its amplitude multiplied by a factor."""
    out = coefficients.copy()
    out[1:] *= factor
    return out


def shrink_factor(problem: Problem, coefficients: Array) -> float:
    """Return the largest factor <= 1 of the amplitude that keeps position, velocity and acceleration."""
    limits, q0 = problem.setting.robot.limits, coefficients[0]
    extremes = problem.setting.family.series(coefficients).extremes()
    used = [
        (extremes.q.upper - q0) / (limits.upper - q0),
        (q0 - extremes.q.lower) / (q0 - limits.lower),
        extremes.dq.largest / limits.velocity,
        extremes.ddq.largest / limits.acceleration,
    ]
    if np.any(q0 >= limits.upper) or np.any(q0 <= limits.lower):
        return 0.0
    return float(min(1.0, (1.0 - _STRICT) / max(float(np.max(share)) for share in used)))


def refine(problem: Problem, start: Array, recorder: Recorder) -> Array:
    """Return variables of a search on the fine grid, with more clearance where a rule breaks between its points."""
    x, clearance = start, 0.0
    for _ in range(3):
        x = minimise(problem.fine, x, recorder, iterations=120, clearance=clearance)
        lack = problem.lack(problem.coefficients(x))
        if lack <= 0.0 or recorder.expired():
            break
        clearance += 1.2 * lack + 1e-5
    return x


class _Watch(ca.Callback):  # type: ignore[misc]
    """Shows every iterate of the optimiser to a recorder and stops it at the deadline."""

    def __init__(self, recorder: Recorder, variables: int, rows: int, ended: Callable[[], bool]) -> None:
        ca.Callback.__init__(self)
        self._recorder, self._variables, self._rows, self._ended = recorder, variables, rows, ended
        self.construct("watch", {})

    def get_n_in(self) -> int:
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, index: int) -> str:
        return str(ca.nlpsol_out(index))

    def get_name_out(self, index: int) -> str:
        return "ret"

    def get_sparsity_in(self, index: int) -> Any:
        sizes = {"x": self._variables, "lam_x": self._variables, "f": 1, "g": self._rows, "lam_g": self._rows}
        return ca.Sparsity.dense(sizes.get(ca.nlpsol_out(index), 0), 1)

    def eval(self, arguments: Any) -> list[int]:
        """Look at an iterate; a return value of 1 stops the optimiser."""
        x, f = np.array(arguments[0]).ravel(), float(arguments[1])
        self._recorder.offer(x, f)
        return [int(self._recorder.expired() or self._ended())]


def minimise(program: Program, start: Array, recorder: Recorder, *, iterations: int, clearance: float = 0.0) -> Array:
    """Return the variables at which IPOPT ends; the recorder sees every iterate of its interior-point method.

    The Hessian is approximated with limited memory: the searches that this allows in a given time lead further than the
    fewer with exact second derivatives. clearance [m] is kept from rules beyond what the grid asks for.
    """
    options: dict[str, Any] = {} if program.jacobian is None else {"jac_g": program.jacobian}
    options |= {
        "print_time": False,
        "error_on_fail": False,
        "iteration_callback_ignore_errors": False,
        "show_eval_warnings": False,
        "ipopt": _IPOPT | {"max_iter": iterations, **_STEPS[program.setting.criterion]},
    }
    problem = {"x": program.x, "f": program.cost, "g": program.rows}
    lower, upper = program.bounds(clearance)
    with nothing_swallowed() as ended:
        options["iteration_callback"] = _Watch(recorder, program.x.shape[0], program.rows.shape[0], ended)
        solution = ca.nlpsol("search", "ipopt", problem, options)(x0=start, lbg=lower, ubg=upper)
    x = np.array(solution["x"]).ravel()
    recorder.conclude(x)
    return x


def random_start(
    problem: Problem, rng: np.random.Generator, draws: int = 100, expired: Callable[[], bool] = lambda: False
) -> Array:
    """Return variables of the best of random trajectories, each as large as its limits allow."""
    setting = problem.setting
    program, best = problem.coarse, (float("inf"), np.zeros(problem.size))
    waves = problem.free[1:]
    order = (waves - 1) % setting.family.harmonics + 1
    for _ in range(draws):
        table = np.zeros(problem.scale.shape)
        table[waves] = rng.normal(size=(len(waves), setting.robot.n)) / np.sqrt(order)[:, None]
        coefficients = problem.scale * table
        coefficients[0] = setting.poses[rng.integers(len(setting.poses))]
        coefficients[1:] *= _joint_factors(problem, coefficients)
        x = problem.variables(coefficients)
        value = float(program.value(x))
        if value < best[0]:
            best = (value, x)
        if expired():
            break
    return best[1]


def _joint_factors(problem: Problem, coefficients: Array) -> Array:
    """Return by joint the factor [n] that brings a motion to its nearest limit, from samples."""
    setting, limits = problem.setting, problem.setting.robot.limits
    points = 16 * setting.family.harmonics
    motion = setting.family.series(coefficients).motion(np.arange(points) / points * setting.family.period)
    room = np.minimum(limits.upper - coefficients[0], coefficients[0] - limits.lower)
    used = [
        np.abs(motion.q - coefficients[0]).max(axis=0) / room,
        np.abs(motion.dq).max(axis=0) / limits.velocity,
        np.abs(motion.ddq).max(axis=0) / limits.acceleration,
    ]
    return np.asarray(0.95 / np.max(used, axis=0))


def end_cost(problem: Problem, x: Array) -> float:
    """Return the exact cost of variables at which a search ended; inf where they break a limit beyond a grid's slip."""
    if not np.all(np.isfinite(x)):
        return float("inf")
    coefficients = problem.coefficients(x)
    if shrink_factor(problem, coefficients) < _NEARLY or problem.lack(coefficients) > _SLIP:
        return float("inf")
    values = problem.evaluate(coefficients)
    return values.condition if problem.setting.criterion == "condition" else values.log10_det
