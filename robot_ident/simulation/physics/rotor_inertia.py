"""Rotor inertia of the plant."""

from __future__ import annotations

from typing import Self

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, home_inertia


class RotorInertia(Physics):
    """Inertia Ia of the rotor on the joint side, in place of the armature that the robot's description gives."""

    name = "rotor_inertia"
    parameters = (Value("rotor_inertia", "kg m^2", "kg", lower=0.0),)
    largest = 2.5
    sizes = ("rotor_inertia",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return the armature and a quarter of the joint's inertia."""
        return {"rotor_inertia": float(robot.drives.armature[joint]) + 0.25 * float(home_inertia(robot)[joint])}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether it has a column of its own: elsewhere it merges with rigid-body parameters."""
        from robot_ident.model.base_parameters import reduce_to_base

        return joint in reduce_to_base(robot).free_rotors

    def scaled(self, factor: float) -> Self:
        """Return it with the part beyond the armature multiplied."""
        armature = float(self.robot.drives.armature[self.joint])
        beyond = armature + factor * (self.values["rotor_inertia"] - armature)
        return type(self)(self.robot, self.place, {"rotor_inertia": beyond})

    def contribution(self, x: Instant) -> Contribution:
        """Return the inertia beyond the armature, which M(q) has already."""
        beyond = self.values["rotor_inertia"] - float(self.robot.drives.armature[self.joint])
        return Contribution(inertia={(self.joint, self.joint): beyond})
