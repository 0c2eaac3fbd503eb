"""A phenomenon of the plant that no catalogue holds: a gear whose ratio varies over a turn."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value


class UnknownGearError(Physics):
    """A gear out of round: of the motor's torque u the joint gets u (1 + r sin(m q + phase)), with m teeth or lobes."""

    name = "unknown_gear_error"
    parameters = (
        Value("gear_error", "1", "1", -0.9, 0.9),
        Value("lobes", "1/rad", "1/m", lower=0.1),
        Value("phase", "rad", "rad"),
    )
    sizes = ("gear_error",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 4 % five times a turn."""
        return {"gear_error": 0.04, "lobes": 5.0, "phase": 0.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return 5 to 11 lobes."""
        return {"gear_error": 0.04, "lobes": float(rng.integers(5, 12)), "phase": rng.uniform(-np.pi, np.pi)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that doesn't arrive."""
        wave = ca.sin(self.values["lobes"] * x.q[self.joint] + self.values["phase"])
        return Contribution(torque={self.joint: -self.values["gear_error"] * wave * x.command[self.joint]})
