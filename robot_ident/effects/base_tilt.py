"""Base that doesn't stand level; and whether the rigid arm holds a column already."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import pinocchio as pin

from robot_ident.effects.effect import Coefficient, Course, Effect, Mathematics, Signals, Torques
from robot_ident.robot.rigid_body import RigidBody
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


_SPANNED = 1e-8  # share of a column's norm that may remain


def spans_sine(rigid: RigidBody, joint: int, angle: float = 0.0) -> bool:
    """Return whether a torque sin(q - angle) on a joint merges with gravity on the links, no other torque along with
    it.
    """
    motion, basis = _span(rigid)
    column = np.zeros((motion.samples, rigid.n))
    column[:, joint] = np.sin(motion.q[:, joint] - angle)
    c = column.ravel() / np.linalg.norm(column)
    return bool(np.linalg.norm(c - basis @ (basis.T @ c)) < _SPANNED)


def gravity_loads(rigid: RigidBody, joint: int) -> bool:
    """Return whether gravity on some link gives a torque on a joint."""
    motion, _ = _span(rigid)
    still = np.zeros((5, rigid.n))
    y = rigid.regressor(Motion(motion.q[:5], still, still))
    return bool(np.abs(y[:, joint]).max() > 1e-6)


_OFF_AXIS = 0.05  # m by which the next joint must lie off an axis for the link to have a direction
_LEVEL = 0.3  # sine of the angle between axis and vertical from which on a link can point up


def upright(rigid: RigidBody, joint: int) -> float | None:
    """Return the angle of a revolute joint at which the next joint off its axis lies straight above it, the joints
    between at zero; None where the axis is nearly vertical or no joint lies off it.
    """
    model = rigid.model
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    here = data.oMi[joint + 1]
    turning = pin.computeJointJacobian(model, data, pin.neutral(model), joint + 1)[3:]
    axis = here.rotation @ np.reshape(turning, (3, model.nv))[:, joint]  # Pinocchio gives one joint no second index
    up = -np.array(model.gravity.linear, dtype=float)
    up /= max(float(np.linalg.norm(up)), 1e-12)
    up -= axis * (axis @ up)
    if np.linalg.norm(up) < _LEVEL:
        return None
    for further in range(joint + 2, model.njoints):
        arm = data.oMi[further].translation - here.translation
        arm = arm - axis * (axis @ arm)
        if np.linalg.norm(arm) > _OFF_AXIS:
            return float(np.arctan2(axis @ np.cross(arm, up), arm @ up))
    return None


@lru_cache(maxsize=8)
def _span(rigid: RigidBody) -> tuple[Motion, Array]:
    """Return random states and an orthonormal basis of the regressor's columns there [N n, rank]."""
    rng = np.random.default_rng(1991)
    samples = 10 * rigid.n + 30
    draw = rng.uniform(-1.0, 1.0, (3, samples, rigid.n))
    motion = Motion(np.pi * draw[0], 2.0 * draw[1], 4.0 * draw[2])
    y = rigid.regressor(motion).reshape(samples * rigid.n, -1)
    u, s, _ = np.linalg.svd(y, full_matrices=False)
    return motion, u[:, s > 1e-10 * s[0]]
