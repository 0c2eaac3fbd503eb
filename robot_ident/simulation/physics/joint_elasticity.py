"""An elastic transmission of the plant."""

from __future__ import annotations

from typing import Any, Self

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class JointElasticity(Physics):
    """A shaft of stiffness k and damping d between motor and link: two masses, of which the encoder sees the motor.

    The motor has the armature of the robot's description, or a fifth of what the joint feels where that is unknown; the
    link has the rest (Spong 1987).
    """

    name = "joint_elasticity"
    parameters = (Value("stiffness", "Nm/rad", "N/m", lower=1.0), Value("damping", "Nm s/rad", "N s/m", lower=0.0))
    largest = 4.0
    shaft = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a stiffness that the joint's torque twists by 2 mrad."""
        stiffness = strength(robot, joint) / 0.002
        return {"stiffness": stiffness, "damping": 1e-3 * stiffness}

    def scaled(self, factor: float) -> Self:
        """Return it softer by a factor."""
        softer = {key: self.values[key] / factor for key in ("stiffness", "damping")}
        return type(self)(self.robot, self.place, softer)

    def contribution(self, x: Instant) -> Contribution:
        """Return nothing: it acts as a shaft."""
        return Contribution()

    def transmit(self, twist: Any, rate: Any) -> tuple[Any, Any, Any]:
        """Return k twist + d rate, k and d."""
        k, d = self.values["stiffness"], self.values["damping"]
        return k * twist + d * rate, k, d
