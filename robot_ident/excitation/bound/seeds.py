"""States to start from: small trajectories within all limits, and poses at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.excitation.bound.states import StateSet
from robot_ident.excitation.feasibility import allowed_poses, rule_margins
from robot_ident.excitation.setting import Family
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_TRAJECTORIES = 12
_POSES = 40
_SHRINKINGS = 12


def seed_motions(robot: Robot, states: StateSet, rng: np.random.Generator, family: Family) -> Motion:
    """Return samples of random trajectories that keep the limits (made smaller until they do), and poses at rest.

    The samples of each keep all moments exactly, and a pose at rest does so too: whatever else is added, a distribution
    exists that keeps them.
    """
    poses = allowed_poses(robot, _POSES, spread=0.95)
    still = np.zeros_like(poses)
    parts = [Motion(poses, still, still)]
    for q0 in poses[rng.permutation(len(poses))[:_TRAJECTORIES]]:
        parts.append(_trajectory(robot, states, rng, q0, family))
    return stacked(parts)


def stacked(motions: Sequence[Motion]) -> Motion:
    """Return the states of several motions as one list."""
    return Motion(
        np.vstack([motion.q for motion in motions]),
        np.vstack([motion.dq for motion in motions]),
        np.vstack([motion.ddq for motion in motions]),
    )


def _trajectory(robot: Robot, states: StateSet, rng: np.random.Generator, q0: Array, family: Family) -> Motion:
    points = 4 * family.harmonics + 4  # more than three times the harmonics: products of three average without error
    table = np.zeros((1 + 2 * family.harmonics, robot.n))
    table[family.free] = states.velocity * rng.normal(size=(len(family.free), robot.n)) / np.sqrt(len(family.orders))
    table[0] = q0
    for _ in range(_SHRINKINGS):
        motion = family.motion(table, points)
        q, dq, ddq = family.series(table).extremes()
        inside = (q.upper < states.upper) & (q.lower > states.lower)
        inside &= (dq.largest < states.velocity) & (ddq.largest < states.acceleration)
        if np.all(inside) and np.all(rule_margins(robot, motion.q) > 0.0):
            return motion
        table[1:] *= np.where(inside & ~np.all(inside), 1.0, 0.6)
    table[1:] = 0.0
    return family.motion(table, points)
