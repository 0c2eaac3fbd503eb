"""An encoder of the plant that turns out of centre."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between


class EncoderEccentricity(Physics):
    """A scale whose centre lies off the axis: it shows q + atan2(r sin(h (q - q0)), 1 - r cos(h (q - q0))).

    r: offset over the radius of the scale, which is the largest error [rad]; h = 1 once a turn, 2 for an oval ring. The
    servo, too, sees what the encoder shows.
    """

    name = "encoder_eccentricity"
    parameters = (
        Value("encoder_eccentricity", "rad", "m", lower=0.0, upper=0.5),
        Value("position", "rad", "m"),
        Value("harmonic", "1", "1/m", lower=0.1),
    )
    sizes = ("encoder_eccentricity",)
    largest = 2.5
    reads = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 8 mrad once a turn."""
        return {"encoder_eccentricity": 0.008, "position": 0.5, "harmonic": 1.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return 5 to 10 mrad, once or twice a turn."""
        size, position = between(rng, 0.005, 0.01), rng.uniform(-np.pi, np.pi)
        return {"encoder_eccentricity": size, "position": position, "harmonic": float(rng.choice([1.0, 2.0]))}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the joint turns."""
        return not robot.prismatic[joint]

    def contribution(self, x: Instant) -> Contribution:
        """Return nothing: the arm doesn't know of it."""
        return Contribution()

    def misread(self, q: Any) -> Any:
        """Return what the encoder shows too much."""
        r, angle = self.values["encoder_eccentricity"], self.values["harmonic"] * (q - self.values["position"])
        return ca.atan(r * ca.sin(angle) / (1 - r * ca.cos(angle)))
