"""The rigid arm of the plant: inertia matrix and bias torque by one Newton-Euler recursion (Featherstone 2008, chapters
5 and 6) with the links' parameters as numbers: several times shorter than the regressor that designs excitations.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import placements


def links_function(robot: Robot) -> Any:
    """Return the CasADi function (q, dq) -> (M [n, n] with armature, Coriolis, centrifugal and gravity torque [n])."""
    q, v = ca.SX.sym("q", robot.n), ca.SX.sym("v", robot.n)
    mass, bias = links(robot, q, v, robot.rigid.parameters)
    return ca.Function("links", [q, v], [mass + ca.diag(ca.DM(np.array(robot.drives.armature))), bias], {"cse": True})


def links(robot: Robot, q: Any, v: Any, parameters: Any) -> tuple[Any, Any]:
    """Return M [n, n] and bias torque [n] of links with standard parameters [10 n] at q and v, as expressions.

    Column k of M is the torque that accelerates joint k alone, from rest and without gravity.
    """
    still = ca.SX(robot.n, 1)
    bias = links_torque(robot, q, v, still, np.array(robot.rigid.model.gravity.linear), parameters)
    units = ca.horzsplit(ca.SX.eye(robot.n))
    columns = [links_torque(robot, q, still, unit, np.zeros(3), parameters) for unit in units]
    return ca.tril2symm(ca.tril(ca.horzcat(*columns))), bias


def links_torque(robot: Robot, q: Any, v: Any, dv: Any, gravity: Any, parameters: Any) -> Any:
    """Return the torque [n] of the links at positions, velocities v and accelerations dv [n], outward then inward.

    gravity [3] m/s^2 in the base.
    """
    w, dw, a = ca.SX(3, 1), ca.SX(3, 1), -_sparse(gravity)
    chain = placements(robot, q)
    wrenches = []
    for j, (rotation, p, linear, angular) in enumerate(chain):
        a = ca.mtimes(rotation.T, a + ca.cross(dw, p) + ca.cross(w, ca.cross(w, p)))
        w, dw = ca.mtimes(rotation.T, w), ca.mtimes(rotation.T, dw)
        a = a + 2 * ca.cross(w, linear * v[j]) + linear * dv[j]
        dw = dw + ca.cross(w, angular * v[j]) + angular * dv[j]
        w = w + angular * v[j]
        wrenches.append(_wrench(parameters[10 * j : 10 * j + 10], w, dw, a))
    out, force, moment = ca.SX.zeros(robot.n), ca.SX.zeros(3), ca.SX.zeros(3)
    for j in reversed(range(robot.n)):
        rotation, p, linear, angular = chain[j]
        force, moment = force + wrenches[j][0], moment + wrenches[j][1]
        out[j] = ca.dot(linear, force) + ca.dot(angular, moment)
        force = ca.mtimes(rotation, force)
        moment = ca.mtimes(rotation, moment) + ca.cross(p, force)
    return out


def _wrench(parameters: Any, w: Any, dw: Any, a: Any) -> tuple[Any, Any]:
    """Return the force and the moment about the origin of a link's frame that give it angular velocity w, dw/dt, and
    acceleration a of its origin: of its mass m, first moment h and inertia about the origin.
    """
    values = ca.vertsplit(_sparse(parameters))
    m, h = values[0], ca.vertcat(*values[1:4])
    inertia = ca.reshape(ca.vertcat(*(values[k] for k in (4, 5, 7, 5, 6, 8, 7, 8, 9))), 3, 3)
    force = m * a + ca.cross(dw, h) + ca.cross(w, ca.cross(w, h))
    spin = ca.cross(w, ca.mtimes(inertia, w))
    return force, ca.cross(h, a) + ca.mtimes(inertia, dw) + spin


def _sparse(values: Any) -> Any:
    return ca.sparsify(ca.SX(values))
