"""A payload of the plant."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import regressor_expression
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value


class Payload(Physics):
    """A point mass m at (x, y, z) [m] in the frame of the end effector.

    It changes all the arm's equations: torque is linear in the inertial parameters of the last link, to which m, m p
    and m (p^2 I - p p^T) are added.
    """

    name = "payload"
    parameters = (
        Value("payload", "kg", "kg", lower=0.0),
        *(Value(axis, "m", "m") for axis in ("x", "y", "z")),
    )
    scope = "robot"
    side = "link"
    sizes = ("payload",)
    loads_gear = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a fortieth of the arm's mass at the end effector."""
        mass = sum(float(inertia.mass) for inertia in list(robot.rigid.model.inertias)[1:])
        return {"payload": mass / 40, "x": 0.0, "y": 0.0, "z": 0.0}

    def contribution(self, x: Instant) -> Contribution:
        """Return inertia and torque of the mass."""
        n, model = self.robot.n, self.robot.rigid.model
        frame = model.frames[model.getFrameId(self.robot.end_effector)]
        rotation, origin = ca.DM(np.array(frame.placement.rotation)), ca.DM(np.array(frame.placement.translation))
        p = origin + ca.mtimes(rotation, ca.vertcat(*(self.values[axis] for axis in ("x", "y", "z"))))
        m = self.values["payload"]
        moment = m * (ca.dot(p, p) * ca.SX.eye(3) - ca.mtimes(p, p.T))
        entries = [moment[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        added = ca.vertcat(m, m * p, *entries)
        q, v, ddq = ca.vertcat(*x.q), ca.vertcat(*x.v), ca.SX.sym("ddq", n)
        last = 10 * (frame.parentJoint - 1)
        torque = ca.mtimes(regressor_expression(self.robot, q, v, ddq)[:, last : last + 10], added)
        mass, bias = ca.jacobian(torque, ddq), ca.substitute(torque, ddq, ca.SX.zeros(n))
        inertia = {(i, j): mass[i, j] for i in range(n) for j in range(n)}
        return Contribution(torque=dict(enumerate(ca.vertsplit(bias))), inertia=inertia)
