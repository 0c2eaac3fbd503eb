"""A joint that is mounted elsewhere than the URDF says."""

from __future__ import annotations

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class LinkLength(Effect):
    """The joint's origin lies off by (x, y, z) in the frame of the joint before: the torque changes by its derivative
    with the place of all links from this joint on.
    """

    name = "link_length"
    equation = "dtau/dr r"
    meaning = "origin of the joint off by x, y, z in the frame before"
    coefficients = tuple(Coefficient(axis, "mm", "mm") for axis in ("x", "y", "z"))
    symmetry = "conservative"
    signature = "over acceleration and products of speeds, on the joints before; below 0.2 Nm in slow motion"
    confused_with = ("rotor_inertia",)
    experiment = "measure the tool's place from outside; fast motion of two neighbouring joints shows it in the torque"
    magnitude = "5-50 mm"
    uses_torque = True
    symbolic = False
    regression = False
    measuring = True
    evidence = "with the joint's origin moved the model follows the effort better than with any effect"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Not at the first joint, whose place moves nothing."""
        return "where the first joint stands changes no torque" if joint == 0 else None

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return dtau/dx, dtau/dy, dtau/dz, Nm per mm."""
        if torques is None or torques.rigid is None:
            return np.zeros((motion.samples, self.robot.n, 3))
        return 1e-3 * torques.rigid.mounted(self.joint)
