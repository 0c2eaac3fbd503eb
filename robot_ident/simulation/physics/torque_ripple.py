"""Torque ripple of the plant."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class TorqueRipple(Physics):
    """Torque in lines over the motor's angle: A (sin(N q + phase) + second sin(2 N q)), N [1/rad] of the joint.

    N is the gear ratio times the lines a turn of the motor: 1/2 (flex spline), 1 (rotor), 2, 4 (poles, teeth).
    """

    name = "torque_ripple"
    parameters = (
        Value("torque_ripple", "Nm", "N"),
        Value("order", "1/rad", "1/m", lower=0.1),
        Value("phase", "rad", "rad"),
        Value("second", "1", "1", lower=0.0, upper=1.0),
    )
    largest = 2.0
    sizes = ("torque_ripple",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 1 % of the joint's torque, once a turn of the motor (gear ratio 100 where it is unknown)."""
        ratio = float(robot.drives.gear_ratio[joint])
        order = ratio if np.isfinite(ratio) else 100.0
        return {"torque_ripple": 0.01 * strength(robot, joint), "order": order, "phase": 0.0, "second": 0.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return lines at 1/2, 1 or 2 of the motor's turn, with up to a fifth of a second harmonic."""
        usual = cls.typical(robot, joint)
        order = usual["order"] * float(rng.choice([0.5, 1.0, 2.0]))
        return usual | {"order": order, "phase": rng.uniform(-np.pi, np.pi), "second": rng.uniform(0.0, 0.2)}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the gear ratio is known."""
        return bool(np.isfinite(robot.drives.gear_ratio[joint]))

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque at this angle."""
        angle = self.values["order"] * x.q[self.joint]
        wave = ca.sin(angle + self.values["phase"]) + self.values["second"] * ca.sin(2 * angle)
        return Contribution(torque={self.joint: self.values["torque_ripple"] * wave})
