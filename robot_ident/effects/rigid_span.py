"""Whether the rigid arm holds a column already."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from robot_ident.robot.rigid_body import RigidBody
from robot_ident.signals.motion import Array, Motion

_SPANNED = 1e-8  # share of a column's norm that may remain


def spans_sine(rigid: RigidBody, joint: int) -> bool:
    """Return whether a torque sin(q) on a joint merges with gravity on the links (no other torque along with it)."""
    motion, basis = _span(rigid)
    column = np.zeros((motion.samples, rigid.n))
    column[:, joint] = np.sin(motion.q[:, joint])
    c = column.ravel() / np.linalg.norm(column)
    return bool(np.linalg.norm(c - basis @ (basis.T @ c)) < _SPANNED)


def gravity_loads(rigid: RigidBody, joint: int) -> bool:
    """Return whether gravity on some link gives a torque on a joint."""
    motion, _ = _span(rigid)
    still = np.zeros((5, rigid.n))
    y = rigid.regressor(Motion(motion.q[:5], still, still))
    return bool(np.abs(y[:, joint]).max() > 1e-6)


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
