"""Samples that are not from the instants of their stamps."""

from __future__ import annotations

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.signals.motion import Array, Motion


class StampJitter(Effect):
    """Samples taken at instants off the clock by e, of which the stamps know nothing: positions are off by dq e and
    torques by dtau/dt e.

    It makes no torque: the average over periods is smoothed, and the scatter of the periods grows with speed.
    """

    name = "stamp_jitter"
    equation = "q(t + e), tau(t + e)"
    meaning = "samples off the instants of their stamps"
    coefficients = (Coefficient("jitter", "ms", "ms", positive=True),)
    symmetry = "conservative"
    signature = "none in the mean; the scatter of positions grows with speed, of all joints at the same instants"
    confused_with = ()
    also_like = ("a path that doesn't repeat", "an encoder that is read late")
    experiment = "record the drive's own stamps (the header's, not those of arrival), or another clock beside them"
    magnitude = "0.2-2 ms rms"
    scope = "robot"
    symbolic = False
    regression = False
    measuring = True
    evidence = "the scatter of positions between periods rises with the square of speed, alike at all joints"

    def hidden_in(self, motion: Motion) -> str | None:
        """Make no torque in any motion."""
        return "samples off the clock make scatter, not torque; record with the drive's own stamps"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return nothing."""
        return np.zeros((motion.samples, self.robot.n, 1))
