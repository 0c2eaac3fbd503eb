"""A phenomenon of the plant that no catalogue holds: friction where two joints move fast at once."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, full_speed, strength


class UnknownProduct(Physics):
    """Dry friction that rises by f |dq dq_o| / (vm vm_o): with the product of two joints' speeds."""

    name = "unknown_product"
    parameters = (Value("product", "Nm", "N", lower=0.0), Value("other", "1", "1", lower=1, structural=True))
    sizes = ("product",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 15 % of the joint's torque at full speed of both."""
        other = joint + 2 if joint + 1 < robot.n else joint
        return {"product": 0.15 * strength(robot, joint), "other": float(max(other, 1))}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return the typical size with any other joint."""
        other = rng.choice([k + 1 for k in range(robot.n) if k != joint])
        return cls.typical(robot, joint) | {"other": float(other)}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether there is another joint."""
        return robot.n > 1

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at these speeds."""
        other = int(self.values["other"]) - 1
        speeds = full_speed(self.robot, self.joint) * full_speed(self.robot, other)
        return Contribution(
            friction={self.joint: self.values["product"] * ca.fabs(x.v[self.joint] * x.v[other]) / speeds}
        )
