"""Viscous friction of the plant."""

from __future__ import annotations

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class Viscous(Physics):
    """Friction b dq, taken implicitly (trapezoidal rule)."""

    name = "viscous"
    parameters = (Value("viscous", "Nm s/rad", "N s/m", lower=0.0),)
    sizes = ("viscous",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 5 % of the joint's torque at full speed (1 rad/s where no limit is known)."""
        speed = float(robot.limits.velocity[joint])
        return {"viscous": 0.05 * strength(robot, joint) / (speed if np.isfinite(speed) else 1.0)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the damping b."""
        return Contribution(damping={self.joint: self.values["viscous"]})
