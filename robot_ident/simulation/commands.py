"""What the drives are told, step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.servo import Servo


@dataclass(frozen=True)
class Commands:
    """What the drives are told in N steps: everything at the middle of the step.

    q [N, n], dq [N, n]: reference. torque [N, n] Nm: mean feed-forward, which falls by jump [N, n] at `fraction` [N, n]
    of the step.
    """

    q: Array
    dq: Array
    torque: Array
    jump: Array
    fraction: Array

    @property
    def steps(self) -> int:
        """Number of steps N."""
        return len(self.q)

    def rows(self) -> Array:
        """Return [N, 5 n], a row a step."""
        return np.concatenate([self.q, self.dq, self.torque, self.jump, self.fraction], axis=1)

    @classmethod
    def of(cls, servo: Servo, half_steps: Motion) -> Commands:
        """Return what a servo makes of a reference given at 0, h/2, h, ... N h (2 N + 1 instants).

        Its friction compensation c sign(dq_ref) jumps where dq_ref, taken as linear over the step, is zero: the jump
        isn't smeared over the step, nor put off to its end.
        """
        middle, before, after = half_steps[1::2], half_steps.dq[0:-1:2], half_steps.dq[2::2]
        smooth, level = servo.ahead(middle)
        s0, s1 = np.sign(before), np.sign(after)
        turns = s0 * s1 < 0
        span = np.where(turns, before - after, 1.0)
        fraction = np.where(turns, before / span, np.where(s0 == 0, 0.0, 1.0))
        mean = smooth + level * (fraction * s0 + (1 - fraction) * s1)
        return cls(middle.q, middle.dq, mean, level * (s0 - s1), fraction)

    @classmethod
    def open_loop(cls, torque: Array) -> Commands:
        """Return a torque [N, n] Nm that is applied whatever the motion, for drives without gains (`Servo.none`)."""
        zero = np.zeros(np.shape(torque))
        return cls(zero, zero, np.asarray(torque, dtype=float), zero, zero)
