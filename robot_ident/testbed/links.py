"""The rigid arm of the plant: inertia matrix and bias torque with the fewest operations.

Composite bodies and a Newton-Euler recursion (Featherstone 2008, chapters 5 and 6), written for link frames as URDF
has them; several times shorter than the regressor that designs excitations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot


@dataclass(frozen=True)
class Body:
    """Mass m [kg], first moment h [kg m] and inertia I [kg m^2] about the origin of its frame."""

    m: Any
    h: Any
    inertia: Any

    @classmethod
    def of(cls, robot: Robot, link: int) -> Body:
        """Return a link of a robot."""
        m, hx, hy, hz, xx, xy, yy, xz, yz, zz = robot.rigid.parameters[10 * link : 10 * link + 10]
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return cls(ca.SX(float(m)), ca.SX(_sparse(np.array([hx, hy, hz]))), ca.SX(_sparse(inertia)))

    def seen_from(self, rotation: Any, p: Any) -> Body:
        """Return it in the frame before, in which its own has `rotation` and origin p."""
        h = ca.mtimes(rotation, self.h)
        turned = _symmetric(ca.mtimes(ca.mtimes(rotation, self.inertia), rotation.T))
        both = ca.mtimes(p, h.T) + ca.mtimes(h, p.T) + self.m * ca.mtimes(p, p.T)
        parallel = ca.trace(both) * ca.SX.eye(3) - both
        return Body(self.m, h + self.m * p, turned + _symmetric(parallel))

    def joined(self, other: Body) -> Body:
        """Return both as one body."""
        return Body(self.m + other.m, self.h + other.h, self.inertia + other.inertia)

    def wrench(self, w: Any, dw: Any, a: Any) -> tuple[Any, Any]:
        """Return the force and the moment about the origin that give it angular velocity w, dw/dt, and acceleration a
        of its origin.
        """
        force = self.m * a + ca.cross(dw, self.h) + ca.cross(w, ca.cross(w, self.h))
        spin = ca.cross(w, ca.mtimes(self.inertia, w))
        return force, ca.cross(self.h, a) + ca.mtimes(self.inertia, dw) + spin


def links_function(robot: Robot) -> Any:
    """Return the CasADi function (q, dq) -> (M [n, n] with armature, Coriolis, centrifugal and gravity torque [n])."""
    q, v = ca.SX.sym("q", robot.n), ca.SX.sym("v", robot.n)
    chain = [_frame(robot, joint, q[joint]) for joint in range(robot.n)]
    bodies = [Body.of(robot, link) for link in range(robot.n)]
    mass = _inertia(chain, bodies) + ca.diag(ca.DM(np.array(robot.drives.armature)))
    bias = _bias(chain, bodies, v, np.array(robot.rigid.model.gravity.linear))
    return ca.Function("links", [q, v], [mass, bias], {"cse": True})


def _frame(robot: Robot, joint: int, q: Any) -> tuple[Any, Any, Any, Any]:
    """Return rotation and origin of a joint's frame in the one before, and how it moves along and about its axes."""
    model = robot.rigid.model
    data = model.joints[1 + joint].createData()
    model.joints[1 + joint].calc(data, np.zeros(1), np.ones(1))
    linear, angular = (_clean(np.array(part)) for part in np.split(np.ravel(data.S), 2))
    placement = model.jointPlacements[1 + joint]
    fixed, origin = ca.SX(_clean(np.array(placement.rotation))), ca.SX(_sparse(np.array(placement.translation)))
    if robot.prismatic[joint]:
        return fixed, origin + ca.mtimes(fixed, ca.SX(linear)) * q, ca.SX(linear), ca.SX.zeros(3)
    skew = ca.SX(ca.sparsify(ca.skew(angular)))
    turn = ca.SX.eye(3) + ca.sin(q) * skew + (1 - ca.cos(q)) * ca.mtimes(skew, skew)  # Rodrigues
    return ca.mtimes(fixed, _with_cosines(turn, skew, q)), origin, ca.SX.zeros(3), ca.SX(angular)


def _with_cosines(turn: Any, skew: Any, q: Any) -> Any:
    """Return Rodrigues' rotation; about an axis of the frame with single sines and cosines as entries."""
    square = ca.DM(ca.mtimes(skew, skew))
    if not np.isin(np.array(square), (-1.0, 0.0)).all():
        return turn
    return ca.SX.eye(3) + ca.SX(square) + ca.sin(q) * skew - ca.cos(q) * ca.SX(ca.sparsify(square))


def _clean(values: Any) -> Any:
    """Return numbers with rounding errors of the URDF's angles taken out."""
    nearest = np.round(values)
    return _sparse(np.where(np.abs(values - nearest) < 1e-12, nearest, values))


def _inertia(chain: list[tuple[Any, ...]], bodies: list[Body]) -> Any:
    n = len(chain)
    mass, carried = ca.SX(n, n), bodies[-1]
    for j in reversed(range(n)):
        _, _, linear, angular = chain[j]
        force = carried.m * linear + ca.cross(angular, carried.h)
        moment = ca.mtimes(carried.inertia, angular) + ca.cross(carried.h, linear)
        for i in reversed(range(j + 1)):
            rotation, p, along, about = chain[i]
            mass[i, j] = ca.dot(along, force) + ca.dot(about, moment)
            mass[j, i] = mass[i, j]
            force = ca.mtimes(rotation, force)
            moment = ca.mtimes(rotation, moment) + ca.cross(p, force)
        if j:
            rotation, p, _, _ = chain[j]
            carried = bodies[j - 1].joined(carried.seen_from(rotation, p))
    return mass


def _bias(chain: list[tuple[Any, ...]], bodies: list[Body], v: Any, gravity: Any) -> Any:
    w, dw, a = ca.SX.zeros(3), ca.SX.zeros(3), ca.SX(ca.DM(-gravity))
    wrenches = []
    for j, (rotation, p, linear, angular) in enumerate(chain):
        a = ca.mtimes(rotation.T, a + ca.cross(dw, p) + ca.cross(w, ca.cross(w, p)))
        w, dw = ca.mtimes(rotation.T, w), ca.mtimes(rotation.T, dw)
        a = a + 2 * ca.cross(w, linear * v[j])
        dw = dw + ca.cross(w, angular * v[j])
        w = w + angular * v[j]
        wrenches.append(bodies[j].wrench(w, dw, a))
    out, force, moment = ca.SX.zeros(len(chain)), ca.SX.zeros(3), ca.SX.zeros(3)
    for j in reversed(range(len(chain))):
        rotation, p, linear, angular = chain[j]
        force, moment = force + wrenches[j][0], moment + wrenches[j][1]
        out[j] = ca.dot(linear, force) + ca.dot(angular, moment)
        force = ca.mtimes(rotation, force)
        moment = ca.mtimes(rotation, moment) + ca.cross(p, force)
    return out


def _symmetric(matrix: Any) -> Any:
    """Return a symmetric matrix whose lower half is its upper one, so that neither is computed twice."""
    return ca.triu2symm(ca.triu(matrix))


def _sparse(values: Any) -> Any:
    return ca.sparsify(ca.DM(values))
