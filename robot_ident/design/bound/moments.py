"""What the time averages of a periodic band-limited motion keep, as rows that are linear in its distribution of states.

Stationarity: E[d/dt f(q, dq)] = 0, for polynomials f of degree 3 or less. Band limit: E[(v' ddq)^2] <= w_max^2
E[(v' dq)^2] for every direction v. Wirtinger: w_min^2 Var q_i <= E[dq_i^2]; since the variance is concave in the
distribution it stands here for a cell of means, lo <= E[q_i] <= hi, in which Var q_i >= E[(q_i - lo) (q_i - hi)]
gives the linear row w_min^2 E[(q_i - lo) (q_i - hi)] <= E[dq_i^2]. Samples of a period average products of degree d
without error when a period has more than d L samples.

The states (q, dq, ddq) that a band-limited periodic motion within a robot's limits can pass through.

Besides the limits themselves every such motion of L harmonics of w keeps, joint by joint and at every time:
dq^2 / (2 A) <= min(upper - q, q - lower), or it could not stop (or, backwards in time, not have come from rest) before
the limit of position; dq^2 + (L w)^2 (q - c)^2 <= (L w h)^2 and ddq^2 + (L w)^2 dq^2 <= (L w V)^2, the inequality of
van der Corput and Schaake (1935) for a trigonometric polynomial bounded by h about c = (lower + upper) / 2, or by V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_ALMOST_STILL = 1e-9  # share of the top speed: the limit dq -> 0 from either side, where sign(dq) still is 1 or -1
_INSIDE = 1.0 - 1e-12  # keeps the root of the ellipse differentiable at its end


@dataclass(frozen=True)
class StateSet:
    """Those states as the image of a cube: q and ddq fill the ranges that dq leaves them.

    For a direction s = +-1 and coordinates c = (a, b, d) of a joint, a in [0, 1], b and d in [-1, 1]:
    dq = s V sin(a pi / 2), q = middle(dq) + b half(dq), ddq = d min(A, L w V cos(a pi / 2)). Coordinates of n joints
    are [3 n]: all a, all b, all d.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    top_frequency: float

    @classmethod
    def of(cls, robot: Robot, lowest: float, highest: float) -> StateSet:
        """Return the states of a robot for motions between two angular frequencies [rad/s], with limits tightened.

        |dq| <= min(V, L w h, sqrt(2 A h), A pi / (2 w_min)) and |ddq| <= min(A, L w V), by Bernstein's inequality, by
        braking and by Favard's inequality for motions without frequencies below w_min: none reaches beyond.
        """
        limits = robot.limits
        half = 0.5 * (limits.upper - limits.lower)
        velocity = np.minimum.reduce([limits.velocity, highest * half, np.sqrt(2.0 * limits.acceleration * half)])
        velocity = np.minimum(velocity, 0.5 * np.pi * limits.acceleration / lowest)
        acceleration = np.minimum(limits.acceleration, highest * velocity)
        return cls(limits.lower, limits.upper, velocity, acceleration, highest)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.lower)

    @property
    def middle(self) -> Array:
        """Middle [n] of the positions."""
        return 0.5 * (self.lower + self.upper)

    @property
    def half(self) -> Array:
        """Half the range [n] of the positions."""
        return 0.5 * (self.upper - self.lower)

    def box(self) -> tuple[Array, Array]:
        """Return the smallest and largest coordinates [3 n]."""
        ones = np.ones(self.n)
        return np.concatenate([0.0 * ones, -ones, -ones]), np.ones(3 * self.n)

    def expressions(self, c: Any, sign: Any) -> tuple[Any, Any, Any]:
        """Return q, dq, ddq [n] as CasADi expressions of coordinates [3 n] and directions [n]."""
        a, b, d = ca.vertsplit(c, self.n)
        angle = 0.5 * np.pi * a
        top = ca.DM(self.velocity)
        dq = sign * top * (_ALMOST_STILL + (1.0 - _ALMOST_STILL) * ca.sin(angle))
        braking = 0.5 * dq**2 / ca.DM(self.acceleration)
        share = dq / ca.DM(self.top_frequency * self.half)
        ellipse = ca.DM(self.half) * ca.sqrt(1.0 - _INSIDE * share**2)
        half = ca.fmin(ca.DM(self.half) - braking, ellipse)
        ddq = d * ca.fmin(ca.DM(self.acceleration), self.top_frequency * top * ca.cos(angle))
        return ca.DM(self.middle) + b * half, dq, ddq

    def coordinates(self, motion: Motion) -> tuple[Array, Array]:
        """Return coordinates [N, 3 n] and directions [N, n] of states, of the nearest where one lies outside."""
        size = np.clip(np.abs(motion.dq) / self.velocity, 0.0, 1.0)
        braking = 0.5 * motion.dq**2 / self.acceleration
        share = np.clip(motion.dq / (self.top_frequency * self.half), -1.0, 1.0)
        half = np.maximum(np.minimum(self.half - braking, self.half * np.sqrt(1.0 - share**2)), 1e-12)
        reach = np.minimum(self.acceleration, self.top_frequency * self.velocity * np.sqrt(1.0 - size**2))
        b = np.clip((motion.q - self.middle) / half, -1.0, 1.0)
        d = np.clip(motion.ddq / np.maximum(reach, 1e-12), -1.0, 1.0)
        directions = np.where(motion.dq < 0.0, -1.0, 1.0)
        return np.concatenate([np.arcsin(size) / (0.5 * np.pi), b, d], axis=1), directions


@dataclass(frozen=True)
class Moments:
    """The rows: exponents [m, 2 n] of the monomials f in (q, dq), directions [J, n], cells of the means lo, hi [n].

    lowest and highest: angular frequencies [rad/s]; lowest 0 leaves Wirtinger out. Positions are taken relative to the
    middle of their range and every quantity relative to its limit, so that rows are near one.
    """

    states: StateSet
    lowest: float
    highest: float
    exponents: Array
    directions: Array
    lo: Array
    hi: Array

    @classmethod
    def of(cls, states: StateSet, lowest: float, highest: float, degree: int) -> Moments:
        """Return the rows for a robot's states; every pair of joints is held to the band in four directions."""
        n = states.n
        powers = [
            np.bincount(chosen, minlength=2 * n)
            for size in range(1, degree + 1)
            for chosen in combinations_with_replacement(range(2 * n), size)
        ]
        single = np.eye(n)
        pairs = [single[i] + sign * single[j] for i in range(n) for j in range(i) for sign in (1.0, -1.0)]
        directions = np.array([*single, *pairs]) / states.velocity
        return cls(states, lowest, highest, np.array(powers, dtype=float), directions, states.lower, states.upper)

    def with_direction(self, v: Array) -> Moments:
        """Return the rows with the band limit in one more direction [n]."""
        return replace(self, directions=np.vstack([self.directions, v]))

    def split(self, joint: int, at: float) -> tuple[Moments, Moments]:
        """Return the rows for the two halves of a joint's cell of means."""
        below, above = self.hi.copy(), self.lo.copy()
        below[joint] = above[joint] = at
        return replace(self, hi=below), replace(self, lo=above)

    @property
    def cells(self) -> tuple[int, ...]:
        """Joints whose mean is confined to less than their range, where Wirtinger's row says something."""
        narrowed = (self.lo > self.states.lower) | (self.hi < self.states.upper)
        return tuple(int(joint) for joint in np.flatnonzero(narrowed)) if self.lowest > 0 else ()

    def equalities(self, motion: Motion) -> Array:
        """Return d/dt f [N, m] at states, in units of the fastest joint's V / h or A / V."""
        states, n = self.states, self.states.n
        z = np.concatenate([(motion.q - states.middle) / states.half, motion.dq / states.velocity], axis=1)
        dz = np.concatenate([motion.dq / states.half, motion.ddq / states.velocity], axis=1) / self._rate()
        powers = self.exponents.astype(int)
        ladder = np.stack([np.ones_like(z), z, z**2, z**3])[: int(powers.max()) + 1]  # [d + 1, N, 2 n]
        out = np.zeros((len(z), len(powers)))
        every = np.arange(2 * n)
        for row, power in enumerate(powers):
            factors = ladder[power, :, every]  # [2 n, N]
            for k in np.flatnonzero(power):
                others = np.delete(factors, k, axis=0)[np.delete(power, k) > 0]
                slope = power[k] * ladder[power[k] - 1, :, k] * dz[:, k]
                out[:, row] += slope * (np.prod(others, axis=0) if len(others) else 1.0)
        return out

    def inequalities(self, motion: Motion) -> Array:
        """Return rows [N, J + 3 c] whose mean is 0 or less: band limit, then for c cells Wirtinger, hi and lo."""
        band = (motion.ddq @ self.directions.T / self.highest) ** 2 - (motion.dq @ self.directions.T) ** 2
        k, half, top = list(self.cells), self.states.half, self.states.velocity
        q = motion.q[:, k]
        spread = self.lowest**2 * (q - self.lo[k]) * (q - self.hi[k]) - motion.dq[:, k] ** 2
        return np.hstack([band, spread / top[k] ** 2, (q - self.hi[k]) / half[k], (self.lo[k] - q) / half[k]])

    def expression(self, equal: Any, quadratic: Any, motion: tuple[Any, Any, Any]) -> Any:
        """Return lambda' d/dt f + mu' h as a CasADi expression.

        equal [m] multipliers of the equalities; quadratic [n, n + 3] what `compact` makes of those of the inequalities.
        """
        q, dq, ddq = motion
        states, n = self.states, self.states.n
        z, dz = ca.SX.sym("z", 2 * n), ca.SX.sym("dz", 2 * n)
        monomials = [
            ca.mtimes([ca.SX(1), *(z[k] ** int(power[k]) if power[k] > 1 else z[k] for k in np.flatnonzero(power))])
            for power in self.exponents
        ]
        slope = ca.jtimes(ca.dot(equal, ca.vertcat(*monomials)), z, dz)
        flow = ca.Function("flow", [z, dz, equal], [slope])
        at = ca.vertcat((q - ca.DM(states.middle)) / ca.DM(states.half), dq / ca.DM(states.velocity))
        rate = ca.vertcat(dq / ca.DM(states.half), ddq / ca.DM(states.velocity)) / self._rate()
        band = ca.bilin(quadratic[:, :n], ddq, ddq) / self.highest**2 - ca.bilin(quadratic[:, :n], dq, dq)
        square, linear, constant = (quadratic[:, n + k] for k in range(3))
        spread = square * (self.lowest**2 * q**2 - dq**2) + linear * q + constant
        return flow(at, rate, equal) + band + ca.sum1(spread)

    def compact(self, multipliers: Array) -> Array:
        """Return the multipliers [J + 3 c] of the inequalities as coefficients [n, n + 3] of one quadratic form."""
        count, k = len(self.directions), list(self.cells)
        out = np.zeros((self.states.n, self.states.n + 3))
        out[:, :-3] = self.directions.T @ (multipliers[:count, None] * self.directions)
        spread, above, below = multipliers[count:].reshape(3, len(k))
        spread = spread / self.states.velocity[k] ** 2
        net = (above - below) / self.states.half[k]
        lo, hi = self.lo[k], self.hi[k]
        out[k, -3] = spread
        out[k, -2] = net - self.lowest**2 * spread * (lo + hi)
        out[k, -1] = self.lowest**2 * spread * lo * hi + (below * lo - above * hi) / self.states.half[k]
        return out

    def _rate(self) -> float:
        states = self.states
        return float(max(np.max(states.velocity / states.half), np.max(states.acceleration / states.velocity)))
