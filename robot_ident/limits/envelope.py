"""The envelope of motions that a robot has run: a new motion stays within it, certified like any other limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Limits, Robot
from robot_ident.robot.workspace import Plane, WorkspaceRule
from robot_ident.signals.motion import Array, Motion, frozen_array

_LEAST = 0.02  # rad or m: a joint that moves less in all of them hardly moves
_THIN = 1e-3  # m: a volume as flat as the tool's path in a plane gets this much on either side


def within_envelope(robot: Robot, motions: Sequence[Motion], places: Array) -> Robot:
    """Return a robot whose limits are the envelope of motions that it has run, its own limits kept as well.

    Position: from the lowest to the highest; velocity and acceleration: the largest of each joint; the tool: the volume
    that 14 planes (across the axes and the diagonals of the cube) cut around all its `places` [N, 3] m. Limits that the
    robot's files lack are given by this. Raises InputError where a joint hardly moved.
    """
    q = np.concatenate([motion.q for motion in motions])
    lower, upper = np.maximum(robot.limits.lower, q.min(axis=0)), np.minimum(robot.limits.upper, q.max(axis=0))
    still = [name for name, span in zip(robot.joints, upper - lower, strict=True) if span < _LEAST]
    if still:
        moving = ",".join(name for name in robot.joints if name not in still)
        way_out = f"; hold it: --joints {moving}" if moving else ""
        raise InputError(f"--from: {', '.join(still)} hardly moves in these recordings{way_out}")
    speed = np.max([np.abs(motion.dq).max(axis=0) for motion in motions], axis=0)
    acceleration = np.max([np.abs(motion.ddq).max(axis=0) for motion in motions], axis=0)
    limits = Limits(
        lower=frozen_array(lower),
        upper=frozen_array(upper),
        velocity=frozen_array(np.minimum(robot.limits.velocity, speed)),
        acceleration=frozen_array(np.minimum(robot.limits.acceleration, acceleration)),
        torque=robot.limits.torque,
        current=robot.limits.current,
    )
    return replace(robot, limits=limits, workspace=(*robot.workspace, tool_volume(robot.end_effector, places)))


def tool_volume(frame: str, places: Array) -> WorkspaceRule:
    """Return the rule that keeps a frame in the volume of its places [N, 3] m, cut by 14 planes around them."""
    clauses = []
    for normal in _directions():
        along = places @ normal
        low, high = float(along.min()), float(along.max())
        if high - low < 2.0 * _THIN:
            low, high = low - _THIN, high + _THIN
        x, y, z = (float(c) for c in normal)
        clauses += [(Plane((x, y, z), low),), (Plane((-x, -y, -z), -high),)]
    return WorkspaceRule(frame, tuple(clauses), f"{frame} where it has been before")


def _directions() -> Array:
    """Return 7 unit vectors [7, 3]: the axes and the diagonals of the cube, one of each pair of opposites."""
    found = [v for v in product((-1, 0, 1), repeat=3) if v > (0, 0, 0) and np.count_nonzero(v) != 2]
    return np.array([np.array(v, dtype=float) / np.linalg.norm(v) for v in found])
