"""Encoder that doesn't turn about the joint's axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques, scaled
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class EncoderEccentricity(Effect):
    """An encoder or gear wheel mounted off its centre: the position reads too much by a cos(h q) + b sin(h q), and the
    torque of the model changes by -D[tau] times that.
    """

    name = "encoder_eccentricity"
    equation = "-D[tau](a cos(h q) + b sin(h q))"
    meaning = "error of the measured position, periodic in a turn"
    coefficients = tuple(Coefficient(name, "mrad", "mrad", largest=100.0) for name in ("cos", "sin"))
    inner = (Inner("h", "", "", 1.0, 2.0, (1.0, 2.0), continuous=False),)
    symmetry = "conservative"
    signature = "once (or twice) a turn, over gravity and acceleration"
    confused_with = ("cable", "torque_ripple", "joint_elasticity")
    experiment = "measure the link's position from outside; a motion can't tell it from a cable"
    magnitude = "2-20 mrad at the link / 1-5 mrad"
    uses_torque = True
    symbolic = False

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Turn."""
        return "a prismatic joint's encoder has no turn" if joint is not None and robot.prismatic[joint] else None

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return the same as expressions."""
        h, j = self.setting["h"], self.joint
        c, s, v, a = m.cos(h * x.q[j]), m.sin(h * x.q[j]), x.dq[j], x.ddq[j]
        cosine = (c, -h * s * v, -(h**2) * c * v**2 - h * s * a)
        sine = (s, h * c * v, -(h**2) * s * v**2 + h * c * a)
        return [scaled(-1e-3, course.displaced(j, error)) for error in (cosine, sine)]

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return -D[tau] cos(h q) and -D[tau] sin(h q), Nm per mrad; derivatives along time by the chain rule."""
        out = np.zeros((motion.samples, self.robot.n, 2))
        if torques is None or torques.rigid is None:
            return out
        h, j = self.setting["h"], self.joint
        c, s, v, a = np.cos(h * motion.q[:, j]), np.sin(h * motion.q[:, j]), motion.dq[:, j], motion.ddq[:, j]
        cosine = (c, -h * s * v, -(h**2) * c * v**2 - h * s * a)
        sine = (s, h * c * v, -(h**2) * s * v**2 + h * c * a)
        for k, error in enumerate((cosine, sine)):
            displacement = np.zeros((3, motion.samples, self.robot.n))
            displacement[:, :, j] = error
            out[:, :, k] = -1e-3 * torques.rigid.displaced(Motion(*displacement))
        return out
