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
    """Return the CasADi function (q, dq) -> (M [n, n] with armature, Coriolis, centrifugal and gravity torque [n]).

    Column k of M is the torque that accelerates joint k alone, from rest and without gravity.
    """
    q, v, still = ca.SX.sym("q", robot.n), ca.SX.sym("v", robot.n), ca.SX(robot.n, 1)
    chain = placements(robot, q)
    bias = _torque(robot, chain, v, still, np.array(robot.rigid.model.gravity.linear))
    units = ca.horzsplit(ca.SX.eye(robot.n))
    columns = ca.horzcat(*(_torque(robot, chain, still, unit, np.zeros(3)) for unit in units))
    mass = ca.tril2symm(ca.tril(columns)) + ca.diag(ca.DM(np.array(robot.drives.armature)))
    return ca.Function("links", [q, v], [mass, bias], {"cse": True})


def _torque(robot: Robot, chain: list[tuple[Any, ...]], v: Any, dv: Any, gravity: Any) -> Any:
    """Return the torque [n] of the links at velocities v and accelerations dv [n], outward then inward."""
    w, dw, a = ca.SX(3, 1), ca.SX(3, 1), ca.SX(_sparse(-gravity))
    wrenches = []
    for j, (rotation, p, linear, angular) in enumerate(chain):
        a = ca.mtimes(rotation.T, a + ca.cross(dw, p) + ca.cross(w, ca.cross(w, p)))
        w, dw = ca.mtimes(rotation.T, w), ca.mtimes(rotation.T, dw)
        a = a + 2 * ca.cross(w, linear * v[j]) + linear * dv[j]
        dw = dw + ca.cross(w, angular * v[j]) + angular * dv[j]
        w = w + angular * v[j]
        wrenches.append(_wrench(robot, j, w, dw, a))
    out, force, moment = ca.SX.zeros(robot.n), ca.SX.zeros(3), ca.SX.zeros(3)
    for j in reversed(range(robot.n)):
        rotation, p, linear, angular = chain[j]
        force, moment = force + wrenches[j][0], moment + wrenches[j][1]
        out[j] = ca.dot(linear, force) + ca.dot(angular, moment)
        force = ca.mtimes(rotation, force)
        moment = ca.mtimes(rotation, moment) + ca.cross(p, force)
    return out


def _wrench(robot: Robot, link: int, w: Any, dw: Any, a: Any) -> tuple[Any, Any]:
    """Return the force and the moment about the origin of a link's frame that give it angular velocity w, dw/dt, and
    acceleration a of its origin: of its mass m, first moment h and inertia about the origin.
    """
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = robot.rigid.parameters[10 * link : 10 * link + 10]
    h, inertia = _sparse([hx, hy, hz]), _sparse([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    force = float(m) * a + ca.cross(dw, h) + ca.cross(w, ca.cross(w, h))
    spin = ca.cross(w, ca.mtimes(inertia, w))
    return force, ca.cross(h, a) + ca.mtimes(inertia, dw) + spin


def _sparse(values: Any) -> Any:
    return ca.sparsify(ca.DM(np.array(values)))
