"""A joint that counts the other way round than the URDF."""

from __future__ import annotations

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.signals.motion import Array, Motion


class MirroredJoint(Effect):
    """A joint whose position counts against the URDF's axis, with its effort or without: q -> -q, tau -> -tau.

    All joints' torques depend on it through the arm's shape: it is tried as a whole, and no column makes it up.
    """

    name = "mirrored_joint"
    equation = "tau_j(q_j -> -q_j), -tau_j"
    meaning = "a joint that counts the other way round than the URDF's axis"
    coefficients = (Coefficient("turned", "%", "%"),)
    symmetry = "conservative"
    signature = "gross, on all joints that carry the turned one or are carried by it"
    confused_with = ("exchanged_joints", "effort_gain")
    also_like = ("a wrong URDF",)
    experiment = "turn this joint by hand to larger positions and look which way the model of the URDF turns"
    magnitude = "several times the noise, where the arm bends at all"
    symbolic = False
    regression = False
    measuring = True
    evidence = "with the joint's position turned round the rigid model follows the effort down to the noise"

    def hidden_in(self, motion: Motion) -> str | None:
        """Make no torque of its own in any motion."""
        return "a joint that counts the other way round is a matter of the URDF's axis or the driver, not of the motion"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return nothing."""
        return np.zeros((motion.samples, self.robot.n, 1))
