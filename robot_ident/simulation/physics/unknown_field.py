"""A phenomenon of the plant that no catalogue holds: a smooth torque over all positions."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength

WAVES = 8


class UnknownField(Physics):
    """A random smooth torque over the positions of three joints: the mean of eight waves A sqrt(2) cos(k . q + phase).

    Components of k are normal with standard deviation `roughness` [1/rad]; `seed` chooses the field.
    """

    name = "unknown_field"
    parameters = (
        Value("field", "Nm", "N"),
        Value("roughness", "1/rad", "1/m", lower=0.0),
        Value("seed", "1", "1", lower=0, structural=True),
    )
    sizes = ("field",)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return 2 % of the joint's torque that changes within a third of a radian."""
        return {"field": 0.02 * strength(robot, joint), "roughness": 3.0, "seed": 0.0}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return any field."""
        return cls.typical(robot, joint) | {"seed": float(rng.integers(1 << 31)), "roughness": rng.uniform(2.5, 4.0)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque in this pose."""
        rng = np.random.default_rng(int(self.values["seed"]))
        near = sorted(range(self.robot.n), key=lambda k: abs(k - self.joint))[:3]
        waves = []
        for _ in range(WAVES):
            k, phase = rng.standard_normal(len(near)), rng.uniform(-np.pi, np.pi)
            angle = sum((float(k[i]) * x.q[j] for i, j in enumerate(near)), start=0.0)
            waves.append(ca.cos(self.values["roughness"] * angle + phase))
        total = sum(waves, start=0.0)
        return Contribution(torque={self.joint: self.values["field"] * np.sqrt(2 / WAVES) * total})
