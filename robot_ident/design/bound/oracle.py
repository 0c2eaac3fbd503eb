"""The search for the state that would add most: multi-start ascent of the dual's reduced cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from scipy.optimize import minimize

from robot_ident.design.bound.moments import Moments, StateSet
from robot_ident.design.family import Family
from robot_ident.limits.feasibility import allowed_poses, rule_margins
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.signals.motion import Array, Motion, joined

_STEEPNESS = 2e3  # of the penalty, in log det per m^2 of a broken rule: ends within a millimetre, then polished
_SLACK = 1e-6  # m by which a rule may be broken: more states only loosen the bound
_ITERATIONS = 60
_MEMORY = 6  # iterations among which the worst must be beaten (Grippo, Lampariello and Lucidi 1986)
_APART = 0.02  # distance of two states in the cube that count as the same
_BESIDE = 0.05  # standard deviation in the cube of a start beside a state


class Prices(NamedTuple):
    """What the dual asks: Y [p, p], multipliers lambda [m] and, compactly, those of the inequalities [n, n + 3]."""

    inverse: Array
    equal: Array
    quadratic: Array

    def towards(self, other: Prices, share: float) -> Prices:
        """Return the dual point at a share of the way to another; whatever lies between two is one too."""
        return Prices(*((1.0 - share) * mine + share * theirs for mine, theirs in zip(self, other, strict=True)))


@dataclass(frozen=True)
class Found:
    """States of a search, the best first, with their rows S^-1/2 Phi D [K, n, p] and rewards [K]."""

    motion: Motion
    rows: Array
    reward: Array


class Oracle:
    """Finds states of largest tr(Y A(x)) - lambda' d/dt f(x) - mu' h(x), A = Phi' S^-1 Phi, within the rules."""

    def __init__(self, robot: Robot, phi: Any, moments: Moments, scale: Array, weight: Array) -> None:
        """Lay out the functions; scale D [p] and weight S^-1/2 [n] make the rows near one."""
        states, n = moments.states, moments.states.n
        self.states, self._columns = states, len(scale)
        c, sign = ca.SX.sym("c", 3 * n), ca.SX.sym("sign", n)
        q, dq, ddq = motion = states.expressions(c, sign)
        rows = ca.densify(ca.mtimes([ca.diag(ca.DM(weight)), phi(q, dq, ddq), ca.diag(ca.DM(scale))]))
        equal, quadratic = ca.SX.sym("equal", len(moments.exponents)), ca.SX.sym("quadratic", n, n + 3)
        cost = moments.expression(equal, quadratic, motion)
        clauses = _clauses(robot, q)
        broken = sum((ca.fmax(0, -reduce(ca.fmax, clause)) ** 2 for clause in clauses), ca.SX(0))
        seed = ca.SX.sym("seed", n, len(scale))
        slope = ca.jtimes(rows, c, seed, True)
        fixed = [equal, quadratic]
        self._value = ca.Function("value", [c, sign, *fixed], [ca.densify(rows), cost, broken])
        self._slope = ca.Function(
            "slope",
            [c, sign, *fixed, seed],
            [ca.densify(slope), ca.densify(ca.gradient(cost, c)), ca.densify(ca.gradient(broken, c))],
        )
        self._states = ca.Function("states", [c, sign], [q, dq, ddq])
        margins = ca.vertcat(*(alternative for clause in clauses for alternative in clause))
        self._margins = ca.Function("margins", [c, sign], [ca.densify(margins), ca.densify(ca.jacobian(margins, c))])
        ends = np.cumsum([0, *(len(clause) for clause in clauses)])
        self._spans = [range(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        self._mapped: dict[tuple[str, int], Any] = {}

    def rows(self, c: Array, sign: Array) -> tuple[Motion, Array]:
        """Return the states and the rows [K, n, p] of coordinates [K, 3 n] and directions [K, n]."""
        free = np.zeros(self._value.size1_in(2)), np.zeros(self._value.size_in(3))
        rows = self._rows(self._at("value", len(c))(c.T, sign.T, *free)[0], len(c))
        q, dq, ddq = (np.array(part).T for part in self._states(c.T, sign.T))
        return Motion(q, dq, ddq), rows

    def search(self, prices: Prices, c: Array, sign: Array, polished: int, kept: int) -> Found:
        """Return the best distinct states of ascents from starts c [K, 3 n], sign [K, n]; `polished` of them by SQP."""
        c = self._ascend(prices, c, sign)
        value = self._reward(prices, c, sign)[0]
        chosen = _distinct(c, sign, np.argsort(-value).tolist(), 3 * kept)
        c, sign = c[chosen], sign[chosen]
        better = [self._polish(prices, c[k], sign[k]) for k in range(min(polished, len(c)))]
        c, sign = self.allowed(np.vstack([*better, c]), np.vstack([sign[: len(better)], sign]))
        reward = self._reward(prices, c, sign, penalty=False)[0]
        chosen = _distinct(c, sign, np.argsort(-reward).tolist(), kept)
        motion, rows = self.rows(c[chosen], sign[chosen])
        return Found(motion, rows, reward[chosen])

    def rewards(self, prices: Prices, motion: Motion) -> Array:
        """Return the rewards [K] of given states."""
        return self._reward(prices, *self.states.coordinates(motion), penalty=False)[0]

    def random_starts(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Return coordinates [K, 3 n], half of them at the ends of their ranges, and directions [K, n] at random."""
        lower, upper = self.states.box()
        c = rng.uniform(lower, upper, (count, len(lower)))
        ends = np.where(rng.random(c.shape) < 0.5, lower, upper)
        c = np.where(rng.random(c.shape) < 0.5, ends, c)
        return c, rng.choice([-1.0, 1.0], (count, self.states.n))

    def starts_beside(self, rng: np.random.Generator, motion: Motion) -> tuple[Array, Array]:
        """Return coordinates [K, 3 n] and directions [K, n] beside given states."""
        c, sign = self.states.coordinates(motion)
        lower, upper = self.states.box()
        return np.clip(c + _BESIDE * rng.normal(size=c.shape), lower, upper), sign

    def allowed(self, c: Array, sign: Array) -> tuple[Array, Array]:
        """Return those of some coordinates [K, 3 n] and directions [K, n] whose states keep the rules."""
        if not self._spans or not len(c):
            return c, sign
        margins = np.array(self._margins(c.T, sign.T)[0]).T
        clauses = [margins[:, span.start : span.stop].max(axis=1) for span in self._spans]
        kept = np.min(clauses, axis=0) >= -_SLACK
        return c[kept], sign[kept]

    def _at(self, name: str, count: int) -> Any:
        if (name, count) not in self._mapped:
            function = self._value if name == "value" else self._slope
            self._mapped[name, count] = function.map(name, "serial", count, [2, 3], [])
        return self._mapped[name, count]

    def _rows(self, flat: Any, count: int) -> Array:
        n, p = self.states.n, self._columns
        return np.array(flat).reshape(n, count, p).transpose(1, 0, 2)

    def _reward(self, prices: Prices, c: Array, sign: Array, *, penalty: bool = True) -> tuple[Array, Array]:
        """Return the rewards [K] and the rows' weights Phi Y [K, n, p]."""
        if not len(c):
            return np.zeros(0), np.zeros((0, self.states.n, self._columns))
        flat, cost, broken = self._at("value", len(c))(c.T, sign.T, prices.equal, prices.quadratic)
        rows = self._rows(flat, len(c))
        priced = rows @ prices.inverse
        reward = np.einsum("kij,kij->k", rows, priced) - np.array(cost).ravel()
        return reward - penalty * _STEEPNESS * len(prices.inverse) * np.array(broken).ravel(), priced

    def _slopes(self, prices: Prices, c: Array, sign: Array, priced: Array, *, penalty: bool = True) -> Array:
        """Return the gradients [K, 3 n] of the rewards."""
        seed = priced.transpose(1, 0, 2).reshape(self.states.n, -1)
        parts = self._at("slope", len(c))(c.T, sign.T, prices.equal, prices.quadratic, seed)
        gain, cost, broken = (np.array(part).T for part in parts)
        return np.asarray(2.0 * gain - cost - penalty * _STEEPNESS * len(prices.inverse) * broken)

    def _ascend(self, prices: Prices, c: Array, sign: Array) -> Array:
        """Return where spectral projected gradients end (Birgin, Martinez and Raydan 2000), for all starts at once."""
        lower, upper = self.states.box()
        value, priced = self._reward(prices, c, sign)
        slope = self._slopes(prices, c, sign, priced)
        pace = 0.1 / np.maximum(np.abs(slope).max(axis=1), 1e-12)
        best_c, best, share = c.copy(), value.copy(), np.ones(len(c))
        recent = np.full((len(c), _MEMORY), -np.inf)
        recent[:, 0] = value
        for iteration in range(1, _ITERATIONS):
            way = np.clip(c + pace[:, None] * slope, lower, upper) - c
            moved = c + share[:, None] * way
            reached, priced = self._reward(prices, moved, sign)
            worst = np.where(np.isfinite(recent), recent, np.inf).min(axis=1)
            gain = np.einsum("kj,kj->k", slope, way)
            taken = reached >= worst + 1e-4 * share * gain
            fresh = self._slopes(prices, moved, sign, priced)
            step, turn = moved - c, slope - fresh
            size, bend = np.einsum("kj,kj->k", step, step), np.einsum("kj,kj->k", step, turn)
            spectral = np.where(bend > 0, size / np.maximum(bend, 1e-300), 10.0 * pace)
            pace = np.where(taken, np.clip(spectral, 1e-10, 1e3), pace)
            c, slope = np.where(taken[:, None], moved, c), np.where(taken[:, None], fresh, slope)
            value = np.where(taken, reached, value)
            share = np.where(taken, 1.0, 0.3 * share)
            recent[:, iteration % _MEMORY] = value
            better = value > best
            best_c[better], best[better] = c[better], value[better]
        return best_c

    def _polish(self, prices: Prices, c: Array, sign: Array) -> Array:
        """Return where sequential quadratic programming ends, with the rules' alternatives as they are chosen there."""
        s = sign[None]

        def value(x: Array) -> float:
            return -float(self._reward(prices, x[None], s, penalty=False)[0][0])

        def slope(x: Array) -> Array:
            priced = self._reward(prices, x[None], s, penalty=False)[1]
            return -self._slopes(prices, x[None], s, priced, penalty=False)[0]

        margins = np.array(self._margins(c, sign)[0]).ravel()
        active = [span[int(np.argmax(margins[span.start : span.stop]))] for span in self._spans]
        rules = {
            "type": "ineq",
            "fun": lambda x: np.array(self._margins(x, sign)[0]).ravel()[active],
            "jac": lambda x: np.array(self._margins(x, sign)[1])[active],
        }
        bounds = list(zip(*self.states.box(), strict=True))
        found = minimize(
            value, c, jac=slope, bounds=bounds, constraints=[rules] if active else [], method="SLSQP",
            options={"maxiter": 40, "ftol": 1e-9},
        )  # fmt: skip
        return np.clip(found.x, *self.states.box()) if np.all(np.isfinite(found.x)) else c


def _clauses(robot: Robot, q: Any) -> list[list[Any]]:
    """Return for every clause of the rules the margins of its alternatives as expressions."""
    out = []
    for rule in robot.workspace:
        x, y, z = ca.vertsplit(frame_function(robot, rule.frame)(q))
        out += [[alternative.value(x, y, z, ca.sqrt) for alternative in clause] for clause in rule.clauses]
    return out


def _distinct(c: Array, sign: Array, order: Sequence[int], most: int) -> list[int]:
    """Return the first of those in an order that are apart from one another."""
    chosen: list[int] = []
    for k in order:
        if len(chosen) == most:
            break
        near = [j for j in chosen if np.max(np.abs(c[j] - c[k])) < _APART and np.array_equal(sign[j], sign[k])]
        if not near:
            chosen.append(k)
    return chosen


_TRAJECTORIES = 12
_POSES = 40
_SHRINKINGS = 12


def seed_motions(robot: Robot, states: StateSet, rng: np.random.Generator, family: Family) -> Motion:
    """Return samples of random trajectories that keep the limits (made smaller until they do), and poses at rest.

    The samples of each keep all moments exactly, and a pose at rest does so too: whatever else is added, a distribution
    exists that keeps them.
    """
    poses = allowed_poses(robot, _POSES, spread=0.95)
    still, chosen = np.zeros_like(poses), poses[rng.permutation(len(poses))[:_TRAJECTORIES]]
    return joined([Motion(poses, still, still), *(_trajectory(robot, states, rng, q0, family) for q0 in chosen)])


def _trajectory(robot: Robot, states: StateSet, rng: np.random.Generator, q0: Array, family: Family) -> Motion:
    points = 4 * family.harmonics + 4  # more than three times the harmonics: products of three average without error
    table = np.zeros((1 + 2 * family.harmonics, robot.n))
    table[family.free] = states.velocity * rng.normal(size=(len(family.free), robot.n)) / np.sqrt(len(family.orders))
    table[0] = q0
    for _ in range(_SHRINKINGS):
        motion = family.motion(table, points)
        q, dq, ddq = family.series(table).extremes()
        inside = (q.upper < states.upper) & (q.lower > states.lower)
        inside &= (dq.largest < states.velocity) & (ddq.largest < states.acceleration)
        if np.all(inside) and np.all(rule_margins(robot, motion.q) > 0.0):
            return motion
        table[1:] *= np.where(inside & ~np.all(inside), 1.0, 0.6)
    table[1:] = 0.0
    return family.motion(table, points)
