"""Constant torque of the plant."""

from __future__ import annotations

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, either_sign, strength


class TorqueOffset(Physics):
    """A torque t0 that the drive gives in every state."""

    name = "torque_offset"
    parameters = (Value("torque_offset", "Nm", "N"),)
    largest = 3.0
    sizes = ("torque_offset",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 1 % of the joint's torque."""
        return {"torque_offset": 0.01 * strength(robot, joint)}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return the typical size in either direction."""
        return {"torque_offset": either_sign(rng) * cls.typical(robot, joint)["torque_offset"]}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque t0."""
        return Contribution(torque={self.joint: self.values["torque_offset"]})
