"""Friction of the plant that grows with what the gear carries."""

from __future__ import annotations

import casadi as ca

from robot_ident.robot.robot import Robot
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class LoadFriction(Physics):
    """Teeth that are pressed together rub more: the level rises by eta (sqrt(tauL^2 + e^2) - e).

    tauL [Nm]: torque on the gear without its rotor's inertia, e [Nm]: preload below which load hardly matters, eta the
    gear's loss as a share of the load.
    """

    name = "load_friction"
    parameters = (Value("load_friction", "1", "1", lower=0.0, upper=0.9), Value("preload", "Nm", "N", lower=0.0))
    largest = 2.5
    sizes = ("load_friction",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a loss of 6 % of the load."""
        return {"load_friction": 0.06, "preload": 0.01 * strength(robot, joint)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at this load."""
        e = self.values["preload"]
        carried = ca.sqrt(x.load[self.joint] ** 2 + e**2 + 1e-12) - e
        return Contribution(friction={self.joint: self.values["load_friction"] * ca.fmax(carried, 0)})
