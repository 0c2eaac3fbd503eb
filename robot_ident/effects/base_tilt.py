"""Base that doesn't stand level."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Mathematics, Signals, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class BaseTilt(Effect):
    """Gravity that isn't where the model has it: to first order tau = gx dtau/dgx + gy dtau/dgy, gx and gy across the
    model's gravity (along the base's x and y on a level floor).

    Links' moments that no motion on a level base shows are those of the URDF.
    """

    name = "base_tilt"
    equation = "gx dtau/dgx + gy dtau/dgy"
    meaning = "gravity across the base: tilt times 9.81 m/s^2"
    coefficients = (Coefficient("gx", "m/s^2", "m/s^2"), Coefficient("gy", "m/s^2", "m/s^2"))
    symmetry = "conservative"
    signature = "periodic in the first joint's angle, on several joints at once"
    confused_with = ("cable", "gravity_spring")
    experiment = "put a level on the base; compare joints: a tilt acts on several, a cable on one"
    magnitude = "1-8 % of g / the same"
    scope = "robot"
    uses_torque = True
    symbolic = False

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Feel gravity."""
        return None if np.any(robot.rigid.model.gravity.linear) else f"robot {robot.name} moves without gravity"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the torque per m/s^2 of gravity in the two directions."""
        if torques is None or torques.rigid is None:
            return np.zeros((motion.samples, self.robot.n, 2))
        return np.stack([torques.rigid.gravity(direction) for direction in self.directions()], axis=2)

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return the same as expressions."""
        return [dict(enumerate(course.gravity(direction))) for direction in self.directions()]

    def directions(self) -> Array:
        """Return two unit vectors [2, 3] across gravity: x and y of the base as far as gravity leaves them."""
        down = np.array(self.robot.rigid.model.gravity.linear, dtype=float)
        down /= np.linalg.norm(down)
        axes = sorted(range(3), key=lambda k: abs(down[k]) > 1 - 1e-9)
        out: list[Array] = []
        for k in axes[:2]:
            across = np.eye(3)[k] - down[k] * down
            across = across - sum((across @ other) * other for other in out)
            if np.linalg.norm(across) > 0.1:
                out.append(across / np.linalg.norm(across))
        return np.array(out if len(out) == 2 else [out[0], np.cross(down, out[0])])
