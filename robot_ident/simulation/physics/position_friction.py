"""Friction of the plant that varies with position."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, dry_friction


class PositionFriction(Physics):
    """A joint that runs hard over a part of its turn: the level rises by f exp(k (cos(h (q - q0)) - 1)).

    f [Nm] at q0 [rad], h how often a turn, k how narrow: the higher k, the stronger the harmonics beyond the first.
    """

    name = "position_friction"
    parameters = (
        Value("position_friction", "Nm", "N", lower=0.0),
        Value("position", "rad", "m"),
        Value("harmonic", "1", "1/m", lower=0.1),
        Value("narrowness", "1", "1", lower=0.01, upper=20.0),
    )
    largest = 2.5
    sizes = ("position_friction",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return half of the joint's Coulomb friction, once a turn."""
        size = 0.5 * dry_friction(robot, joint)
        return {"position_friction": size, "position": 0.3, "harmonic": 1.0, "narrowness": 0.7}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return once or twice a turn, hardest anywhere."""
        drawn = {"position": rng.uniform(-np.pi, np.pi), "harmonic": float(rng.choice([1.0, 2.0]))}
        return cls.typical(robot, joint) | drawn | {"narrowness": between(rng, 0.3, 1.0)}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the joint turns."""
        return not robot.prismatic[joint]

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at this position."""
        angle = self.values["harmonic"] * (x.q[self.joint] - self.values["position"])
        level = self.values["position_friction"] * ca.exp(self.values["narrowness"] * (ca.cos(angle) - 1))
        return Contribution(friction={self.joint: level})
