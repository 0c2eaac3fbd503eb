"""Rotor inertia of a drive, seen through its gear."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import DRIVE_SIDE, Coefficient, Effect, Mathematics, Signals


class RotorInertia(Effect):
    """Inertia of the rotor on the joint side: tau = Ia ddq. Where a link's inertia has the same column it merges with
    it.
    """

    name = "rotor_inertia"
    equation = "Ia ddq"
    meaning = "rotor inertia on the joint side"
    coefficients = (Coefficient("rotor_inertia", "kg m^2", "kg", positive=True),)
    symmetry = "conservative"
    exact = True
    signature = "over acceleration"
    confused_with = ("joint_coupling", "joint_elasticity")
    also_like = ("wrong kinematics",)
    experiment = "fast small motions of this joint alone, where acceleration outweighs gravity"
    magnitude = "0.5-5 / 0.05-1 kg m^2"
    seen_from = DRIVE_SIDE
    before_sensor = "the motor turns its rotor before any torque reaches the sensor"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return ddq."""
        return [{self.joint: x.ddq[self.joint]}]

    def truth(self) -> dict[str, float] | None:
        """Return the robot's armature."""
        return {"rotor_inertia": float(self.robot.drives.armature[self.joint])}
