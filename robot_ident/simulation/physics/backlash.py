"""Backlash of the plant."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, strength


class Backlash(Physics):
    """Play between motor and link: neither feels the other until the gap is crossed, then they meet in a stiff contact.

    The shaft carries k (c + (|c|^2 + e^2)^(1/2) of both flanks) beyond +- gap / 2, with e a twentieth of the gap, and
    damping in contact alone.
    """

    name = "backlash"
    parameters = (
        Value("gap", "rad", "m", lower=1e-6),
        Value("stiffness", "Nm/rad", "N/m", lower=1.0),
        Value("damping", "Nm s/rad", "N s/m", lower=0.0),
    )
    sizes = ("gap",)
    largest = 3.0
    smallest = 0.6
    shaft = True
    step_rate = 4500.0

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a gap of 1 mrad; the joint's torque presses the contact in by 2 mrad."""
        stiffness = strength(robot, joint) / 0.002
        return {"gap": 0.001, "stiffness": stiffness, "damping": 2e-3 * stiffness}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a gap from .5 to 1.5 mrad."""
        return cls.typical(robot, joint) | {"gap": between(rng, 5e-4, 1.5e-3)}

    def contribution(self, x: Instant) -> Contribution:
        """Return nothing: it acts as a shaft."""
        return Contribution()

    def transmit(self, twist: Any, rate: Any) -> tuple[Any, Any, Any]:
        """Return the contact's torque, slope and damping."""
        half = self.values["gap"] / 2
        edge = half / 10
        above, below = ca.sqrt((twist - half) ** 2 + edge**2), ca.sqrt((twist + half) ** 2 + edge**2)
        pressed = twist + (above - below) / 2
        contact = 1 + ((twist - half) / above - (twist + half) / below) / 2
        k, d = self.values["stiffness"] * contact, self.values["damping"] * contact
        return self.values["stiffness"] * pressed + d * rate, k, d
