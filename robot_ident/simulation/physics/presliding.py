"""Friction before sliding of the plant."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.maxwell_slip import MaxwellSlip
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, between, dry_friction

SPREAD = (0.12, 0.3, 0.6, 1.1, 2.0)
"""Reaches of the elements over the mean reach: the friction curve bends gradually."""


class Presliding(Physics):
    """Bristles in place of sharp Coulomb friction: after a reversal friction builds up over a distance.

    Five Maxwell elements share the Coulomb level c; `reach` [rad] is the mean distance at which they slip.
    """

    name = "presliding"
    parameters = (Value("reach", "rad", "m", lower=1e-6), Value("coulomb", "Nm", "N", lower=0.0))
    states = len(SPREAD)
    sizes = ("reach",)
    largest = 4.0
    smallest = 0.1
    replaces = ("coulomb",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a reach of 5 mrad and the joint's own Coulomb friction."""
        return {"reach": 0.005, "coulomb": dry_friction(robot, joint)}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a reach from 2 to 15 mrad."""
        return cls.typical(robot, joint) | {"reach": between(rng, 0.002, 0.015)}

    def _elements(self) -> MaxwellSlip:
        return MaxwellSlip(self.values["coulomb"], [self.values["reach"] * share for share in SPREAD])

    def contribution(self, x: Instant) -> Contribution:
        """Return the force of the bristles, stretched to the middle of the step."""
        elements, moved = self._elements(), x.moved[self.joint]
        return Contribution(
            torque={self.joint: elements.force(elements.stretched(x.state, moved))},
            stiffness={self.joint: elements.stiffness(x.state, moved)},
        )

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return the stretches after the step."""
        return self._elements().stretched(before.state, after.q[self.joint] - before.q[self.joint])
