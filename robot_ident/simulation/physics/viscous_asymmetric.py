"""Viscous friction of the plant that differs between the directions."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, damping, either_sign

EDGE = 0.005
"""Speed [rad/s] over which one direction's friction passes into the other's."""


class ViscousAsymmetric(Physics):
    """Viscous friction larger in one direction by twice `viscous_asymmetric`: a (sqrt(dq^2 + e^2) - e)."""

    name = "viscous_asymmetric"
    parameters = (Value("viscous_asymmetric", "Nm s/rad", "N s/m"),)
    largest = 3.0
    sizes = ("viscous_asymmetric",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 15 % of the joint's viscous friction."""
        return {"viscous_asymmetric": 0.15 * damping(robot, joint)}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return the typical size, larger in either direction."""
        return {"viscous_asymmetric": either_sign(rng) * cls.typical(robot, joint)["viscous_asymmetric"]}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque, even in velocity."""
        v = x.v[self.joint]
        return Contribution(torque={self.joint: self.values["viscous_asymmetric"] * (ca.sqrt(v**2 + EDGE**2) - EDGE)})
