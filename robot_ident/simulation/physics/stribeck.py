"""Stribeck friction of the plant."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, strength


class Stribeck(Physics):
    """More dry friction at low speed: the level rises by f sech((|dq| / vs)^d), so that a joint breaks away with a
    jerk.

    f [Nm] at standstill, vs [rad/s], d: flat at the top, falling exponentially (Makkar et al. 2005 use the same
    family).
    """

    name = "stribeck"
    parameters = (
        Value("stribeck", "Nm", "N", lower=0.0),
        Value("speed", "rad/s", "m/s", lower=1e-6),
        Value("exponent", "1", "1", lower=0.1, upper=4.0),
    )
    largest = 3.0
    sizes = ("stribeck",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 3 % of the joint's torque below .08 rad/s."""
        return {"stribeck": 0.03 * strength(robot, joint), "speed": 0.08, "exponent": 1.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a Stribeck velocity from .03 to .3 rad/s and an exponent from .6 to 1.2."""
        drawn = {"speed": between(rng, 0.03, 0.3), "exponent": between(rng, 0.6, 1.2)}
        return cls.typical(robot, joint) | drawn

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at the joint's speed."""
        ratio = ca.fabs(x.v[self.joint]) / self.values["speed"]
        bent = ca.exp(-ca.fmin(ratio ** self.values["exponent"], 300.0))
        return Contribution(friction={self.joint: self.values["stribeck"] * 2 * bent / (1 + bent**2)})
