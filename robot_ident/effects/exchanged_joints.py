"""Two joints whose readings stand under each other's name."""

from __future__ import annotations

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class ExchangedJoints(Effect):
    """Positions, efforts or both of two joints that are recorded under each other's name.

    It is tried as a whole, and no column makes it up.
    """

    name = "exchanged_joints"
    equation = "q_j <-> q_k, tau_j <-> tau_k"
    meaning = "readings of two joints under each other's name"
    coefficients = (Coefficient("exchanged", "%", "%"),)
    symmetry = "conservative"
    signature = "gross, on both joints: over each other's motion"
    confused_with = ("mirrored_joint", "joint_coupling")
    also_like = ("a wrong URDF",)
    experiment = "move one joint at a time: the name under which its position and effort change is its own"
    magnitude = "many times the noise"
    symbolic = False
    regression = False
    measuring = True
    evidence = "with the two readings exchanged the rigid model follows the effort down to the noise"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Have another joint."""
        return "there is no other joint" if robot.n < 2 else None

    def hidden_in(self, motion: Motion) -> str | None:
        """Make no torque of its own in any motion."""
        return "names that are exchanged are a matter of the driver, not of the motion"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return nothing."""
        return np.zeros((motion.samples, self.robot.n, 1))
