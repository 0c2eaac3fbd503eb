"""The states (q, dq, ddq) that a band-limited periodic motion within a robot's limits can pass through.

Besides the limits themselves every such motion of L harmonics of w keeps, joint by joint and at every time:
dq^2 / (2 A) <= min(upper - q, q - lower), or it could not stop (or, backwards in time, not have come from rest) before
the limit of position; dq^2 + (L w)^2 (q - c)^2 <= (L w h)^2 and ddq^2 + (L w)^2 dq^2 <= (L w V)^2, the inequality of
van der Corput and Schaake (1935) for a trigonometric polynomial bounded by h about c = (lower + upper) / 2, or by V.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

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
        import casadi as ca

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
