"""Friction of the plant that isn't in proportion to speed."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, full_speed, strength


class ViscousNonlinear(Physics):
    """Grease that thins under shear, f asinh(dq / v0) / asinh(vm / v0) (Eyring 1936), and churning oil, g dq |dq| /
    vm^2.

    f, g [Nm]: each at the joint's full speed vm.
    """

    name = "viscous_nonlinear"
    parameters = (
        Value("viscous_nonlinear", "Nm", "N", lower=0.0),
        Value("churning", "Nm", "N", lower=0.0),
        Value("speed", "rad/s", "m/s", lower=1e-4),
    )
    largest = 4.0
    sizes = ("viscous_nonlinear", "churning")

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return shear thinning of 3 % of the joint's torque, which sets in at a twelfth of its speed."""
        size = 0.03 * strength(robot, joint)
        return {"viscous_nonlinear": size, "churning": 0.0, "speed": full_speed(robot, joint) / 12}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return one of the two; thinning sets in between a thirtieth and a quarter of the full speed."""
        size, fast = 0.03 * strength(robot, joint), full_speed(robot, joint)
        speed = between(rng, fast / 30, fast / 4)
        if rng.random() < 0.6:
            return {"viscous_nonlinear": size, "churning": 0.0, "speed": speed}
        return {"viscous_nonlinear": 0.0, "churning": size, "speed": speed}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque against the motion."""
        v, fast, v0 = x.v[self.joint], full_speed(self.robot, self.joint), self.values["speed"]
        thinning = self.values["viscous_nonlinear"] * _asinh(v / v0) / _asinh(fast / v0)
        return Contribution(torque={self.joint: thinning + self.values["churning"] * v * ca.fabs(v) / fast**2})


def _asinh(x: object) -> object:
    """Return asinh by logarithms, odd to the last bit."""
    size = ca.fabs(x)
    return ca.sign(x) * ca.log(size + ca.sqrt(size**2 + 1))
