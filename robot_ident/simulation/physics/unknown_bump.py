"""A phenomenon of the plant that no catalogue holds: a dent at one position."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, either_sign, strength


class UnknownBump(Physics):
    """A torque A exp(-((q - q0) / w)^2 / 2): a dent, a cable that snags, a damaged tooth."""

    name = "unknown_bump"
    parameters = (
        Value("bump", "Nm", "N"),
        Value("position", "rad", "m"),
        Value("width", "rad", "m", lower=1e-4),
    )
    sizes = ("bump",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 5 % of the joint's torque over a tenth of a radian."""
        return {"bump": 0.05 * strength(robot, joint), "position": 0.2, "width": 0.1}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a bump in the middle of what the motion passes, over 3 to 8 % of its range."""
        low, high = np.quantile(motion.q[:, joint], [0.2, 0.8])
        width = float(np.ptp(motion.q[:, joint])) * rng.uniform(0.03, 0.08)
        size = either_sign(rng) * cls.typical(robot, joint)["bump"]
        return {"bump": size, "position": rng.uniform(low, high), "width": width}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque at this position."""
        off = (x.q[self.joint] - self.values["position"]) / self.values["width"]
        return Contribution(torque={self.joint: self.values["bump"] * ca.exp(-(off**2) / 2)})
