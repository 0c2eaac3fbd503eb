"""What the rigid arm holds: torques that merge with its columns, joints that gravity loads, upright links."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from robot_ident.robot.rigid_body import RigidBody
from robot_ident.signals.motion import Array, Motion

_SPANNED = 1e-8  # share of a column's norm that may remain


def spans_sine(rigid: RigidBody, joint: int, angle: float = 0.0) -> bool:
    """Return whether a torque sin(q - angle) on a joint merges with gravity on the links, no other torque along with
    it.
    """
    motion = random_states(rigid)
    column = np.zeros((motion.samples, rigid.n, 1))
    column[:, joint, 0] = np.sin(motion.q[:, joint] - angle)
    return not apart_from_links(rigid, column)


def random_states(rigid: RigidBody) -> Motion:
    """Return the states at which `apart_from_links` takes columns."""
    return _span(rigid)[0]


def apart_from_links(rigid: RigidBody, columns: Array) -> tuple[int, ...]:
    """Return which of some columns [N, n, K] at `random_states` the rigid arm's and those before don't span."""
    _, basis = _span(rigid)
    kept = []
    for k, column in enumerate(columns.reshape(-1, columns.shape[2]).T):
        size = float(np.linalg.norm(column))
        rest = column / max(size, 1e-300)
        for _ in range(2):  # twice is enough (Kahan): once leaves what rounding lets through
            rest = rest - basis @ (basis.T @ rest)
        if size > _SPANNED and np.linalg.norm(rest) > _SPANNED:
            kept.append(k)
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return tuple(kept)


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
