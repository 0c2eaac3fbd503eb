"""A base of the plant that doesn't stand level."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.rigid_body import RigidBody
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.links import links_function
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between


class BaseTilt(Physics):
    """The floor is turned by `tilt_x`, then `tilt_y` [rad], about the base's own axes: gravity comes from elsewhere.

    Gravity torque is linear in the vector g, exactly: tau(g) = sum_k g_k tau(e_k), with Pinocchio's arm in each of
    three fields of gravity.
    """

    name = "base_tilt"
    parameters = (Value("tilt_x", "rad", "rad", -1.5, 1.5), Value("tilt_y", "rad", "rad", -1.5, 1.5))
    scope = "robot"
    side = "link"
    sizes = ("tilt_x", "tilt_y")
    largest = 3.0
    loads_gear = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a tilt of 2 % about both axes."""
        return {"tilt_x": 0.02, "tilt_y": 0.02}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a tilt of 2 to 3 % in any direction."""
        angle, size = rng.uniform(-np.pi, np.pi), between(rng, 0.02, 0.03)
        return {"tilt_x": size * float(np.cos(angle)), "tilt_y": size * float(np.sin(angle))}

    @cached_property
    def _fields(self) -> list[Any]:
        """Functions q -> gravity torque [n] of unit fields along x, y, z."""
        out = []
        for k in range(3):
            model = self.robot.rigid.model.copy()
            model.gravity.linear = np.eye(3)[k]
            q = ca.SX.sym("q", self.robot.n)
            _, bias = links_function(replace(self.robot, rigid=RigidBody(model)))(q, ca.SX.zeros(self.robot.n))
            out.append(ca.Function("field", [q], [bias]))
        return out

    def contribution(self, x: Instant) -> Contribution:
        """Return the change of the gravity torque."""
        g = np.array(self.robot.rigid.model.gravity.linear)
        about_x, about_y = self.values["tilt_x"], self.values["tilt_y"]
        # g in the turned base: R_y^T R_x^T g.
        y = ca.cos(about_x) * g[1] + ca.sin(about_x) * g[2]
        z = -ca.sin(about_x) * g[1] + ca.cos(about_x) * g[2]
        turned = (ca.cos(about_y) * g[0] - ca.sin(about_y) * z, y, ca.sin(about_y) * g[0] + ca.cos(about_y) * z)
        q = ca.vertcat(*x.q)
        torque = sum((fields(q) * (turned[k] - g[k]) for k, fields in enumerate(self._fields)), start=ca.SX(0))
        return Contribution(torque=dict(enumerate(ca.vertsplit(torque))))
