"""What drives and encoders of the simulated robot do to torque and position."""

from __future__ import annotations

from typing import Any, Self

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.testbed.phenomena.phenomenon import (
    Contribution,
    Instant,
    Physics,
    Value,
    between,
    either_sign,
    even,
    log_even,
    one_of,
    strength,
    times,
)


class TorqueOffset(Physics):
    """A torque t0 that the drive gives in every state."""

    name = "torque_offset"
    parameters = (Value("torque_offset", "Nm", "N", usual=times(0.01, strength), drawn=either_sign),)
    largest = 3.0

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque t0."""
        return Contribution(torque={self.joint: self.values["torque_offset"]})


def _gear_ratio(robot: Robot, joint: int) -> float:
    ratio = float(robot.drives.gear_ratio[joint])
    return ratio if np.isfinite(ratio) else 100.0


class TorqueRipple(Physics):
    """Torque in lines over the motor's angle: A (sin(N q + phase) + second sin(2 N q)), N [1/rad] of the joint.

    N is the gear ratio times the lines a turn of the motor: 1/2 (flex spline), 1 (rotor), 2, 4 (poles, teeth).
    """

    name = "torque_ripple"
    parameters = (
        Value("torque_ripple", "Nm", "N", usual=times(0.01, strength)),
        Value("order", "1/rad", "1/m", 0.1, usual=_gear_ratio, drawn=lambda rng, once: once * rng.choice([0.5, 1, 2])),
        Value("phase", "rad", "rad", drawn=even(-np.pi, np.pi)),
        Value("second", "1", "1", lower=0.0, upper=1.0, drawn=even(0.0, 0.2)),
    )
    largest = 2.0

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the gear ratio is known."""
        return bool(np.isfinite(robot.drives.gear_ratio[joint]))

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque at this angle."""
        angle = self.values["order"] * x.q[self.joint]
        wave = ca.sin(angle + self.values["phase"]) + self.values["second"] * ca.sin(2 * angle)
        return Contribution(torque={self.joint: self.values["torque_ripple"] * wave})


class TorqueSaturation(Physics):
    """Iron saturates: of a commanded torque u the joint gets u / (1 + (u / T)^2 ((1 - f)^-2 - 1))^(1/2).

    f: share that is lost at the torque T that the joint is built for. What is recorded is the command, like a current
    times a constant.
    """

    name = "torque_saturation"
    parameters = (Value("torque_saturation", "1", "1", lower=0.0, upper=0.9, usual=0.08),)
    largest = 6.0

    def contribution(self, x: Instant) -> Contribution:
        """Return what is lost."""
        kept = 1 - self.values["torque_saturation"]
        command = x.command[self.joint]
        ratio = (command / strength(self.robot, self.joint)) ** 2
        return Contribution(torque={self.joint: command * (1 - 1 / ca.sqrt(1 + ratio * (kept**-2 - 1)))})


RANGE = (0.003, 0.02)
"""Delays [s] that the channels of real robots have."""


def _late_or_early(rng: np.random.Generator, usual: float) -> float:
    return either_sign(rng) * between(rng, 0.003, 0.01)


class TimeDelay(Physics):
    """The recorded torque lags the recorded position by `time_delay` [s], at one joint or (named without one) at all:
    filters and clocks of the two channels differ.
    """

    name = "time_delay"
    parameters = (Value("time_delay", "s", "s", -0.5, 0.5, usual=0.006, drawn=_late_or_early),)
    scope = "either"
    largest = 2.5

    def scaled(self, factor: float) -> Self:
        """Return it longer or shorter by a factor, between 3 and 20 ms: below half a sample nothing shows one."""
        delay = float(self.values["time_delay"]) * factor
        size = float(np.clip(abs(delay), *RANGE))
        return type(self)(self.robot, self.place, {"time_delay": float(np.copysign(size, delay))})

    def lateness(self) -> float:
        """Return the delay."""
        return float(self.values["time_delay"])


class EncoderEccentricity(Physics):
    """A scale whose centre lies off the axis: it shows q + atan2(r sin(h (q - q0)), 1 - r cos(h (q - q0))).

    r: offset over the radius of the scale, which is the largest error [rad]; h = 1 once a turn, 2 for an oval ring. The
    servo, too, sees what the encoder shows.
    """

    name = "encoder_eccentricity"
    needs = "turning"
    parameters = (
        Value("encoder_eccentricity", "rad", "m", lower=0.0, upper=0.5, usual=0.008, drawn=log_even(0.005, 0.01)),
        Value("position", "rad", "m", usual=0.5, drawn=even(-np.pi, np.pi)),
        Value("harmonic", "1", "1/m", lower=0.1, usual=1.0, drawn=one_of(1.0, 2.0)),
    )
    largest = 2.5
    reads = True

    def misread(self, q: Any) -> Any:
        """Return what the encoder shows too much."""
        r, angle = self.values["encoder_eccentricity"], self.values["harmonic"] * (q - self.values["position"])
        return ca.atan(r * ca.sin(angle) / (1 - r * ca.cos(angle)))
