"""Drives of the plant that give less than they are told at high torque."""

from __future__ import annotations

import casadi as ca

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class TorqueSaturation(Physics):
    """Iron saturates: of a commanded torque u the joint gets u / (1 + (u / T)^2 ((1 - f)^-2 - 1))^(1/2).

    f: share that is lost at the torque T that the joint is built for. What is recorded is the command, like a current
    times a constant.
    """

    name = "torque_saturation"
    parameters = (Value("torque_saturation", "1", "1", lower=0.0, upper=0.9),)
    largest = 6.0
    sizes = ("torque_saturation",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a loss of 8 % at the joint's torque."""
        return {"torque_saturation": 0.08}

    def contribution(self, x: Instant) -> Contribution:
        """Return what is lost."""
        kept = 1 - self.values["torque_saturation"]
        command = x.command[self.joint]
        ratio = (command / strength(self.robot, self.joint)) ** 2
        return Contribution(torque={self.joint: command * (1 - 1 / ca.sqrt(1 + ratio * (kept**-2 - 1)))})
