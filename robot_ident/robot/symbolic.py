"""The rigid arm as CasADi expressions, for gradients and for the simulated plant.

The recursion is written for any chain of revolute and prismatic joints; the tests hold it against Pinocchio.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


def _skew(v: Any) -> Any:
    return ca.vertcat(
        ca.horzcat(0, -v[2], v[1]),
        ca.horzcat(v[2], 0, -v[0]),
        ca.horzcat(-v[1], v[0], 0),
    )


def _rotation(axis: Array, angle: Any) -> Any:
    """Return Rodrigues' rotation about a unit axis; numeric zeros stay structural zeros."""
    k = ca.DM(np.round(axis, 15))
    outer = ca.DM(np.outer(axis, axis).round(15))
    return ca.cos(angle) * (ca.DM.eye(3) - outer) + ca.sin(angle) * ca.sparsify(_skew(k)) + outer


def joint_axis(robot: Robot, joint: int) -> tuple[Array, Array]:
    """Return the linear and angular part of a joint's motion subspace in its own frame."""
    model = robot.rigid.model
    data = model.joints[1 + joint].createData()
    model.joints[1 + joint].calc(data, np.zeros(model.nq), np.ones(model.nv))
    v = data.v
    return np.array(v.linear), np.array(v.angular)


def _clean(matrix: Any) -> Any:
    """Return a numeric matrix as DM with rounding errors of the URDF's angles taken out."""
    array = np.array(matrix, dtype=float)
    nearest = np.round(array)
    return ca.sparsify(ca.DM(np.where(np.abs(array - nearest) < 1e-12, nearest, array)))


def placements(robot: Robot, q: Any) -> list[tuple[Any, Any, Any, Any]]:
    """Return for each joint (R, p, linear axis, angular axis): the pose of its frame in the previous one."""
    out = []
    for joint in range(robot.n):
        placement = robot.rigid.model.jointPlacements[1 + joint]
        linear, angular = joint_axis(robot, joint)
        r, p = _clean(placement.rotation), ca.sparsify(ca.DM(np.array(placement.translation)))
        if robot.prismatic[joint]:
            out.append((r, p + ca.mtimes(r, ca.DM(linear) * q[joint]), _clean(linear), ca.DM.zeros(3)))
        else:
            out.append((ca.mtimes(r, _rotation(angular, q[joint])), p, ca.DM.zeros(3), _clean(angular)))
    return out


def _inertia_columns(w: Any) -> Any:
    """Return L(w) [3, 6] with I w = L(w) [Ixx Ixy Iyy Ixz Iyz Izz]."""
    return ca.vertcat(
        ca.horzcat(w[0], w[1], 0, w[2], 0, 0),
        ca.horzcat(0, w[0], w[1], 0, w[2], 0),
        ca.horzcat(0, 0, 0, w[0], w[1], w[2]),
    )


def _wrench_columns(w: Any, dw: Any, a: Any) -> tuple[Any, Any]:
    """Return force [3, 10] and moment [3, 10] of a link per unit standard parameter, about its frame's origin.

    f = m a + dw x mc + w x (w x mc), n = mc x a + I dw + w x I w (Khalil and Dombre 2002, eq. 9.83).
    """
    carried = _skew(dw) + ca.mtimes(_skew(w), _skew(w))
    force = ca.horzcat(a, carried, ca.SX(3, 6))
    moment = ca.horzcat(ca.SX(3, 1), -_skew(a), _inertia_columns(dw) + ca.mtimes(_skew(w), _inertia_columns(w)))
    return force, moment


def regressor_expression(robot: Robot, q: Any, dq: Any, ddq: Any, gravity: Array | None = None) -> Any:
    """Return Y [n, 10 n] as an expression in q, dq, ddq [n]: tau = Y pi by Newton-Euler, outward then inward.

    gravity [3] m/s^2 in the base: that of the robot where none is given.
    """
    down = robot.rigid.model.gravity.linear if gravity is None else gravity
    w, dw = ca.SX(3, 1), ca.SX(3, 1)
    a = -ca.SX(ca.sparsify(ca.DM(np.array(down, dtype=float))))
    chain = placements(robot, q)
    wrenches = []
    for joint, (r, p, linear, angular) in enumerate(chain):
        a = a + ca.mtimes(_skew(dw), p) + ca.mtimes(_skew(w), ca.mtimes(_skew(w), p))
        a, w, dw = ca.mtimes(r.T, a), ca.mtimes(r.T, w), ca.mtimes(r.T, dw)
        a = a + linear * ddq[joint] + 2 * ca.mtimes(_skew(w), linear * dq[joint])
        dw = dw + angular * ddq[joint] + ca.mtimes(_skew(w), angular * dq[joint])
        w = w + angular * dq[joint]
        wrenches.append(_wrench_columns(w, dw, a))
    rows: list[Any] = [None] * robot.n
    force, moment = ca.SX(3, 0), ca.SX(3, 0)
    for joint in reversed(range(robot.n)):
        r, p, linear, angular = chain[joint]
        force, moment = ca.horzcat(wrenches[joint][0], force), ca.horzcat(wrenches[joint][1], moment)
        row = ca.mtimes(linear.T, force) + ca.mtimes(angular.T, moment)
        rows[joint] = ca.horzcat(ca.SX(1, 10 * joint), row)
        force = ca.mtimes(r, force)
        moment = ca.mtimes(r, moment) + ca.mtimes(_skew(p), force)
    return ca.sparsify(ca.vertcat(*rows))


def frame_function(robot: Robot, frame: str) -> Any:
    """Return the CasADi function q -> position [3] m of a named frame in the base."""
    q = ca.SX.sym("q", robot.n)
    model = robot.rigid.model
    found = model.frames[model.getFrameId(frame)]
    p = ca.SX(ca.DM(np.array(found.placement.translation)))
    chain = placements(robot, q)
    for r, offset, _, _ in reversed(chain[: found.parentJoint]):
        p = offset + ca.mtimes(r, p)
    return ca.Function("frame", [q], [p])


def force_function(robot: Robot, joint: int) -> Any:
    """Return the CasADi function q -> [n, 4]: the torques that drives carry against a force of 1 N along x, y and z of
    the base on the end p of a joint's link, -(dp/dq)' e, and against a spring of 1 N/m to the base's origin,
    (dp/dq)' p.

    The end is where the next joint sits, on the last link the end effector.
    """
    q, model = ca.SX.sym("q", robot.n), robot.rigid.model
    if joint + 1 < robot.n:
        there = model.jointPlacements[joint + 2]
    else:
        frame = model.frames[model.getFrameId(robot.end_effector)]
        there = frame.placement if frame.parentJoint == joint + 1 else type(frame.placement).Identity()
    p = ca.SX(ca.DM(np.array(there.translation)))
    for r, offset, _, _ in reversed(placements(robot, q)[: joint + 1]):
        p = offset + ca.mtimes(r, p)
    slope = ca.jacobian(p, q).T
    return ca.Function("force", [q], [ca.densify(ca.horzcat(-slope, ca.mtimes(slope, p)))])


def placements_function(robot: Robot) -> Any:
    """Return the CasADi function q -> (R [3, 3 n], p [3, n] m): the joints' frames in the base."""
    q = ca.SX.sym("q", robot.n)
    rotation, position = ca.SX.eye(3), ca.SX(3, 1)
    rotations, positions = [], []
    for r, p, _, _ in placements(robot, q):
        position = position + ca.mtimes(rotation, p)
        rotation = ca.mtimes(rotation, r)
        rotations.append(rotation)
        positions.append(position)
    outputs = [ca.densify(ca.horzcat(*rotations)), ca.densify(ca.horzcat(*positions))]
    return ca.Function("placements", [q], outputs)
