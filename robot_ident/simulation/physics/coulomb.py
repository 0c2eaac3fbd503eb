"""Coulomb friction of the plant."""

from __future__ import annotations

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class Coulomb(Physics):
    """Dry friction c Sgn(dq), set-valued at standstill: the joint doesn't move at all until its torque exceeds c."""

    name = "coulomb"
    parameters = (Value("coulomb", "Nm", "N", lower=0.0),)
    sizes = ("coulomb",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 5 % of the joint's torque."""
        return {"coulomb": 0.05 * strength(robot, joint)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the level c."""
        return Contribution(friction={self.joint: self.values["coulomb"]})
