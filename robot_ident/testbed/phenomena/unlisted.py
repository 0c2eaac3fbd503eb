"""Causes that no effect of the catalogue describes: a diagnosis must not name one for them."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.testbed.phenomena.phenomenon import (
    Contribution,
    Instant,
    Physics,
    Value,
    either_sign,
    even,
    full_speed,
    neighbour,
    strength,
    times,
)


class UnknownBump(Physics):
    """A torque A exp(-((q - q0) / w)^2 / 2): a dent, a cable that snags, a damaged tooth."""

    name = "unknown_bump"
    parameters = (
        Value("bump", "Nm", "N", usual=times(0.05, strength)),
        Value("position", "rad", "m", usual=0.2),
        Value("width", "rad", "m", lower=1e-4, usual=0.1),
    )

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


WAVES = 8


class UnknownField(Physics):
    """A random smooth torque over the positions of three joints: the mean of eight waves A sqrt(2) cos(k . q + phase).

    Components of k are normal with standard deviation `roughness` [1/rad]; `seed` chooses the field.
    """

    name = "unknown_field"
    parameters = (
        Value("field", "Nm", "N", usual=times(0.02, strength)),
        Value("roughness", "1/rad", "1/m", lower=0.0, usual=3.0),
        Value("seed", "1", "1", lower=0, structural=True),
    )

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


class UnknownGearError(Physics):
    """A gear out of round: of the motor's torque u the joint gets u (1 + r sin(m q + phase)), with m teeth or lobes."""

    name = "unknown_gear_error"
    parameters = (
        Value("gear_error", "1", "1", -0.9, 0.9, usual=0.04),
        Value("lobes", "1/rad", "1/m", lower=0.1, usual=5.0, drawn=lambda rng, _: float(rng.integers(5, 12))),
        Value("phase", "rad", "rad", drawn=even(-np.pi, np.pi)),
    )

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that doesn't arrive."""
        wave = ca.sin(self.values["lobes"] * x.q[self.joint] + self.values["phase"])
        return Contribution(torque={self.joint: -self.values["gear_error"] * wave * x.command[self.joint]})


class UnknownOscillation(Physics):
    """A torque A sin(2 pi f t), whatever the motion: a pump, a fan, a limit cycle.

    Its two states turn by an exact rotation in each step.
    """

    name = "unknown_oscillation"
    parameters = (
        Value("oscillation", "Nm", "N", usual=times(0.02, strength)),
        # periods of 10 s repeat what is drawn: other frequencies don't outlive an average
        Value("frequency", "Hz", "Hz", lower=1e-3, usual=3.1, drawn=lambda rng, _: float(rng.integers(10, 60)) / 10),
    )
    states = 2

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


class UnknownProduct(Physics):
    """Dry friction that rises by f |dq dq_o| / (vm vm_o): with the product of two joints' speeds."""

    name = "unknown_product"
    needs = "another joint"
    parameters = (
        Value("product", "Nm", "N", lower=0.0, usual=times(0.15, strength)),
        Value("other", "1", "1", lower=1, structural=True, usual=neighbour),
    )

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return the typical size with any other joint."""
        other = rng.choice([k + 1 for k in range(robot.n) if k != joint])
        return cls.typical(robot, joint) | {"other": float(other)}

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at these speeds."""
        other = int(self.values["other"]) - 1
        speeds = full_speed(self.robot, self.joint) * full_speed(self.robot, other)
        return Contribution(
            friction={self.joint: self.values["product"] * ca.fabs(x.v[self.joint] * x.v[other]) / speeds}
        )
