"""Cables and hoses of the plant."""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.maxwell_slip import MaxwellSlip
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength

SPREAD = (0.4, 1.0, 1.8)


class Cable(Physics):
    """A hose package bent along a joint: k (q - q0) (1 + hardening (q - q0)^2), and rubbing strands.

    k [Nm/rad], q0 [rad] where it is relaxed, hardening [1/rad^2]; the strands are Maxwell elements of level `rubbing`
    [Nm] that slip after about `reach` [rad].
    """

    name = "cable"
    parameters = (
        Value("cable", "Nm/rad", "N/m"),
        Value("relaxed", "rad", "m"),
        Value("hardening", "1/rad^2", "1/m^2", lower=0.0),
        Value("rubbing", "Nm", "N", lower=0.0),
        Value("reach", "rad", "m", lower=1e-4),
    )
    states = len(SPREAD)
    side = "link"
    largest = 3.0
    sizes = ("cable", "rubbing")
    loads_gear = True

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 2 % of the joint's torque at a radian, with a tenth of hardening and of rubbing."""
        size = 0.02 * strength(robot, joint)
        return {"cable": size, "relaxed": 0.0, "hardening": 0.1, "rubbing": 0.06 * size, "reach": 0.1}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a cable relaxed somewhere in the middle, with up to .15 of hardening and of rubbing."""
        usual, middle = cls.typical(robot, joint), float(np.mean(motion.q[:, joint]))
        return usual | {
            "relaxed": middle + rng.uniform(-0.5, 0.5),
            "hardening": rng.uniform(0.0, 0.15),
            "rubbing": usual["cable"] * rng.uniform(0.0, 0.08),
            "reach": rng.uniform(0.05, 0.2),
        }

    def _strands(self) -> MaxwellSlip:
        return MaxwellSlip(self.values["rubbing"], [self.values["reach"] * share for share in SPREAD])

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that bends the cable."""
        bent = x.q[self.joint] - self.values["relaxed"]
        spring = self.values["cable"] * bent * (1 + self.values["hardening"] * bent**2)
        strands = self._strands()
        rub = strands.force(strands.stretched(x.state, x.moved[self.joint]))
        return Contribution(torque={self.joint: spring + rub})

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return the stretches of the strands after the step."""
        return self._strands().stretched(before.state, after.q[self.joint] - before.q[self.joint])
