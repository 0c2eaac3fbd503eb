"""Certified distance of a moving frame from the rules of the workspace.

A clause's alternatives are distances g(p), affine or convex with |grad g| = 1, so over an interval of half width h
about t g(t + s) >= g(t) + s dg/dt - A s^2 / 2 with A a bound of the frame's acceleration: a proven lower bound that
converges as h^2. The inside of a cylinder is concave: there the distance from the axis, convex in p, is largest
at an end of the straight way p + s v.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.robot.workspace import Alternative, Plane, WorkspaceRule
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Piece
from robot_ident.trajectories.extremes import Minimum, certified_minimum, certified_positive

TOLERANCE = 1e-7  # m


class FrameKinematics:
    """Position and velocity of a named frame along a motion, and a bound of its acceleration."""

    def __init__(self, robot: Robot, frame: str) -> None:
        """Build the kinematics of a frame of a robot."""
        q, dq = ca.SX.sym("q", robot.n), ca.SX.sym("dq", robot.n)
        p = frame_function(robot, frame)(q)
        self._function: Any = ca.Function("frame", [q, dq], [ca.densify(p), ca.densify(ca.jtimes(p, q, dq))])
        self._robot = robot
        self._frame = robot.rigid.model.frames[robot.rigid.model.getFrameId(frame)]

    def __call__(self, motion: Motion) -> tuple[Array, Array]:
        """Return position [N, 3] m and velocity [N, 3] m/s."""
        p, v = self._function(motion.q.T, motion.dq.T)
        return np.array(p).T, np.array(v).T

    def reach(self, travel: Array) -> Array:
        """Return bounds [n] m of the distance between each joint's origin and the frame; 0 for joints beyond the frame.

        travel [n]: largest |q| of the prismatic joints.
        """
        model, last = self._robot.rigid.model, int(self._frame.parentJoint)
        reach = np.zeros(self._robot.n)
        distance = float(np.linalg.norm(self._frame.placement.translation))
        for joint in reversed(range(last)):
            if self._robot.prismatic[joint]:
                distance += float(travel[joint])
            reach[joint] = distance
            distance += float(np.linalg.norm(model.jointPlacements[1 + joint].translation))
        return reach

    def acceleration_bound(self, speed: Array, acceleration: Array, travel: Array) -> Array:
        """Return a bound [N] m/s^2 of the frame's acceleration.

        |d2p/dt2| <= sum_j r_j |ddq_j| + sum_ij r_ij |dq_i| |dq_j|, where for the later joint k of i and j r_ij is its
        reach when both are revolute, 1 when only the later one is prismatic, and 0 otherwise. speed [N, n],
        acceleration [n] bounds of |dq| and |ddq|.
        """
        n, last = self._robot.n, int(self._frame.parentJoint)
        sliding = np.array(self._robot.prismatic)
        reach = self.reach(travel)
        first = np.where(sliding, 1.0, reach) * (np.arange(n) < last)
        joints = np.arange(n)
        early, late = np.minimum.outer(joints, joints), np.maximum.outer(joints, joints)
        second = np.where(sliding[late], 1.0, reach[late]) * (~sliding[early] & (late < last))
        return np.asarray(first @ acceleration + np.einsum("ki,ij,kj->k", speed, second, speed))


def workspace_margin(
    rule: WorkspaceRule, kinematics: FrameKinematics, piece: Piece, tolerance: float = TOLERANCE
) -> Minimum:
    """Return the certified margin [m] of a rule along a piece of a motion; positive where the rule is kept."""
    bound = _bound(rule, kinematics, piece)
    found = certified_minimum(bound, piece.start, piece.end, tolerance)
    if found.value > 0.0 >= found.lower:  # kept by less than the tolerance
        found = certified_minimum(bound, piece.start, piece.end, 0.5 * found.value)
    return found


def keeps_rule(rule: WorkspaceRule, kinematics: FrameKinematics, piece: Piece) -> bool:
    """Return whether a rule is proven to be kept along a piece of a motion."""
    return certified_positive(_bound(rule, kinematics, piece), piece.start, piece.end)


def _bound(
    rule: WorkspaceRule, kinematics: FrameKinematics, piece: Piece
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the rule's margin at the centres of intervals and its lower bound over them, as a function."""
    travel, top_speed, acceleration = (extremes.largest for extremes in piece.extremes)

    def bound(centres: Array, halves: Array) -> tuple[Array, Array]:
        motion = piece.motion(centres)
        p, v = kinematics(motion)
        speed = np.minimum(np.abs(motion.dq) + halves[:, None] * acceleration, top_speed)
        curvature = kinematics.acceleration_bound(speed, acceleration, travel)
        clauses = [
            np.max([_slack(alternative, p, v, halves, curvature) for alternative in clause], axis=0)
            for clause in rule.clauses
        ]
        values, lower = np.min(clauses, axis=0)
        return values, lower

    return bound


def _slack(alternative: Alternative, p: Array, v: Array, halves: Array, curvature: Array) -> tuple[Array, Array]:
    """Return an alternative's distance at the centres [N] m and its lower bound over the intervals [N] m."""
    value = np.asarray(alternative.value(p[:, 0], p[:, 1], p[:, 2]))
    if isinstance(alternative, Plane):
        slope = v @ np.array(alternative.normal)
    else:
        axis = np.array(alternative.axis)
        away = p - np.array(alternative.point)
        away = away - np.outer(away @ axis, axis)
        if alternative.inside:
            step = halves[:, None] * (v - np.outer(v @ axis, axis))
            farthest = np.maximum(np.linalg.norm(away + step, axis=1), np.linalg.norm(away - step, axis=1))
            return value, alternative.radius - farthest - 0.5 * curvature * halves**2 - 1e-9
        slope = np.einsum("ki,ki->k", away, v) / np.sqrt(np.einsum("ki,ki->k", away, away) + 1e-18)
    return value, value - np.abs(slope) * halves - 0.5 * curvature * halves**2
