"""A phenomenon of the plant that no catalogue holds: a disturbance fixed in time."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength


class UnknownOscillation(Physics):
    """A torque A sin(2 pi f t), whatever the motion: a pump, a fan, a limit cycle.

    Its two states turn by an exact rotation in each step.
    """

    name = "unknown_oscillation"
    parameters = (Value("oscillation", "Nm", "N"), Value("frequency", "Hz", "Hz", lower=1e-3))
    states = 2
    sizes = ("oscillation",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 2 % of the joint's torque at 3.1 Hz."""
        return {"oscillation": 0.02 * strength(robot, joint), "frequency": 3.1}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a frequency from 1 to 6 Hz that periods of 10 s repeat: others don't outlive an average."""
        return cls.typical(robot, joint) | {"frequency": float(rng.integers(10, 60)) / 10}

    def rest(self) -> list[float]:
        """Return cosine and sine at the start."""
        return [1.0, 0.0]

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque in the middle of the step."""
        turn = np.pi * self.values["frequency"] * x.h
        c, s = x.state
        return Contribution(torque={self.joint: self.values["oscillation"] * (s * ca.cos(turn) + c * ca.sin(turn))})

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return cosine and sine after the step."""
        turn = 2 * np.pi * self.values["frequency"] * h
        c, s = before.state
        return [c * ca.cos(turn) - s * ca.sin(turn), s * ca.cos(turn) + c * ca.sin(turn)]
