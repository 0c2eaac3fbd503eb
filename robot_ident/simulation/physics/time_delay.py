"""Torque that the plant records late or early."""

from __future__ import annotations

from typing import Self

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, either_sign

RANGE = (0.003, 0.02)
"""Delays [s] that the channels of real robots have."""


class TimeDelay(Physics):
    """The recorded torque lags the recorded position by `time_delay` [s], at one joint or (named without one) at all:
    filters and clocks of the two channels differ.
    """

    name = "time_delay"
    parameters = (Value("time_delay", "s", "s", -0.5, 0.5),)
    scope = "either"
    sizes = ("time_delay",)
    largest = 2.5

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 6 ms."""
        return {"time_delay": 0.006}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return 3 to 10 ms, late or early."""
        return {"time_delay": either_sign(rng) * between(rng, 0.003, 0.01)}

    def scaled(self, factor: float) -> Self:
        """Return it longer or shorter by a factor, between 3 and 20 ms: below half a sample nothing shows one."""
        delay = float(self.values["time_delay"]) * factor
        size = float(np.clip(abs(delay), *RANGE))
        return type(self)(self.robot, self.place, {"time_delay": float(np.copysign(size, delay))})

    def contribution(self, x: Instant) -> Contribution:
        """Return nothing: the motion doesn't know of it."""
        return Contribution()

    def lateness(self) -> float:
        """Return the delay."""
        return float(self.values["time_delay"])
