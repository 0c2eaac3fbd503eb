"""Elastic end stops of the plant."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, either_sign, strength

EDGE = 0.004
"""Distance [rad] over which the bumper is met: rubber isn't flat."""


class EndStop(Physics):
    """A rubber bumper beyond `position` [rad], in the direction +1 or -1: k p (1 + p / p0), p how far it is pressed in.

    k [Nm/rad], p0 = .6 rad: rubber stiffens.
    """

    name = "end_stop"
    parameters = (
        Value("end_stop", "Nm/rad", "N/m", lower=0.0),
        Value("position", "rad", "m"),
        Value("direction", "1", "1", -1.0, 1.0),
    )
    side = "link"
    largest = 2.0
    sizes = ("end_stop",)
    loads_gear = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a bumper before the upper position limit that takes 15 % of the joint's torque in a radian."""
        upper = float(robot.limits.upper[joint])
        position = 0.8 * upper if np.isfinite(upper) else 1.0
        return {"end_stop": 0.15 * strength(robot, joint), "position": position, "direction": 1.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a bumper that the motion presses in for a twentieth to a fifth of the time."""
        direction = either_sign(rng)
        position = float(np.quantile(direction * motion.q[:, joint], 1 - rng.uniform(0.05, 0.2)))
        return cls.typical(robot, joint) | {"position": direction * position, "direction": direction}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that presses it in."""
        direction = self.values["direction"]
        beyond = direction * (x.q[self.joint] - self.values["position"])
        pressed = (beyond + ca.sqrt(beyond**2 + EDGE**2)) / 2
        return Contribution(torque={self.joint: direction * self.values["end_stop"] * pressed * (1 + pressed / 0.6)})
