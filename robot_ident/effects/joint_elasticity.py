"""Gears and shafts that twist under load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Mathematics, Signals, Torques, scaled
from robot_ident.signals.derivatives import derivatives
from robot_ident.signals.motion import Array, Motion


class JointElasticity(Effect):
    """A gear of stiffness k between motor (with its encoder) and link: the link stands at q - tauL / k (Spong 1987).

    To first order the torque changes by -D[tau] tauL / k, D[tau] the change of the links' torque with their
    displacement and its two derivatives along time; the coefficient is the compliance 1 / k.
    """

    name = "joint_elasticity"
    equation = "-D[tau](tauL) / k"
    meaning = "compliance of the gear between motor and link"
    coefficients = (Coefficient("compliance", "mrad/kNm", "um/N", positive=True),)
    symmetry = "conservative"
    signature = "grows with the 2nd to 4th power of frequency"
    confused_with = ("time_delay", "rotor_inertia", "encoder_eccentricity")
    experiment = "excite 2.5 to 10 Hz; below 0.5 Hz it hides under 0.1 Nm"
    magnitude = "k 1e5-1e6 / 5e3-3e4 Nm/rad: 1-10 / 30-200 mrad/kNm, below 0.1 Nm under 0.5 Hz"
    uses_torque = True
    needs_time = True
    symbolic = False

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return -D[tau] tauL, Nm per mrad/kNm."""
        if torques is None or torques.rigid is None:
            return np.zeros((motion.samples, self.robot.n, 1))
        twist = np.zeros((3, motion.samples, self.robot.n))
        load = torques.load[:, self.joint]
        twist[:, :, self.joint] = (load, *derivatives(load, motion))
        return -1e-6 * torques.rigid.displaced(Motion(*twist))[:, :, None]

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return the same as an expression, the load's derivatives along time by the chain rule."""
        load = x.load[self.joint]
        rate = course.rate(load)
        return [scaled(-1e-6, course.displaced(self.joint, (load, rate, course.rate(rate))))]
