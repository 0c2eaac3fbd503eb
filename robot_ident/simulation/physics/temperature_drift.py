"""Friction of the plant that falls while it warms up."""

from __future__ import annotations

from typing import Any, Self

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, damping

STOPPED = 1e12
"""Time constant [s] with which a temperature is held."""


class TemperatureDrift(Physics):
    """Grease thins as it warms up: damping falls by f (1 - exp(-t / T)), f [Nm s/rad], T [s].

    Its state is the share of the warming that is done; every recording begins cold, with the robot's own viscous
    friction.
    """

    name = "temperature_drift"
    parameters = (
        Value("temperature_drift", "Nm s/rad", "N s/m"),
        Value("time_constant", "s", "s", lower=1e-3),
    )
    states = 1
    sizes = ("temperature_drift",)
    largest = 2.0
    slow = True
    done = 0.0

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a fall of 30 % of the joint's viscous friction within a minute."""
        return {"temperature_drift": 0.3 * damping(robot, joint), "time_constant": 60.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a time constant from 30 to 150 s."""
        return cls.typical(robot, joint) | {"time_constant": between(rng, 30.0, 150.0)}

    def rest(self) -> list[float]:
        """Return the share of the warming that is done at the start."""
        return [self.done]

    def contribution(self, x: Instant) -> Contribution:
        """Return the fall of the damping."""
        return Contribution(damping={self.joint: -self.values["temperature_drift"] * x.state[0]})

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return the share that is done after the step."""
        return [1 - (1 - before.state[0]) * ca.exp(-h / self.values["time_constant"])]

    def held(self, share: float) -> Self:
        """Return the friction of one temperature."""
        other = type(self)(self.robot, self.place, {**self.values, "time_constant": STOPPED})
        other.done = share
        return other

    def share(self, t: Array) -> Array:
        """Return the share of the warming that is done after times t."""
        return np.asarray(1 - (1 - self.done) * np.exp(-t / self.values["time_constant"]))
