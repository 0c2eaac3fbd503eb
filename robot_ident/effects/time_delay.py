"""Delay between position and torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.signals.derivatives import delayed
from robot_ident.signals.motion import Array, Motion


class TimeDelay(Effect):
    """Torque that is stamped later than the position: measured tau(t - d) instead of tau(t), of one joint or, without
    `@JOINT`, of all joints alike.

    The column is (tau(t - shift) - tau(t)) / shift, so that its coefficient is the delay itself, positive where torque
    lags; `shift`, near the delay, gives the shape of the spikes at reversals.
    """

    name = "time_delay"
    equation = "delay (tau(t - shift) - tau(t)) / shift"
    meaning = "delay of the torque behind the position"
    coefficients = (Coefficient("delay", "ms", "ms"),)
    inner = (Inner("shift", "s", "s", -0.04, 0.04, (-0.02, -0.01, -0.005, -0.003, 0.003, 0.006, 0.01, 0.02)),)
    symmetry = "memory"
    signature = "over the rate of torque, spikes at reversals"
    confused_with = ("presliding", "joint_elasticity")
    experiment = "the same path at two speeds: a scale of time stays; a delay of the recording is that of all joints"
    magnitude = "3-20 ms either way: 2-7 Nm / 0.1-0.7 Nm"
    scope = "joint_or_robot"
    uses_torque = True
    needs_time = True
    symbolic = False
    brief = True

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return (tau(t - shift) - tau(t)) / shift, Nm per ms."""
        out = np.zeros((motion.samples, self.robot.n, 1))
        if torques is None:
            return out
        joints = slice(None) if self.whole else slice(self.joint, self.joint + 1)
        change = _earlier(torques, motion, self._shift, joints) - torques.total[:, joints]
        out[:, joints, 0] = change / (1000.0 * self._shift)
        return out

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return the same as an expression, from the state that the motion had a shift ago."""
        shift = self._shift
        joints = range(self.robot.n) if self.whole else (self.joint,)
        return [{j: (course.at(x.total[j], -shift) - x.total[j]) / (1000.0 * shift) for j in joints}]

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Half the shift to half as much again: a small part of a large shift is no delay."""
        one, two = 500.0 * self._shift, 1500.0 * self._shift
        return ((min(one, two), max(one, two)),)

    @property
    def _shift(self) -> float:
        """The shift [s], kept off zero, where the quotient would lose its digits."""
        shift = self.setting["shift"]
        return float(np.copysign(max(abs(shift), 1e-4), shift))


def _earlier(torques: Torques, motion: Motion, shift: float, joints: slice) -> Array:
    """Return the total torque [N, joints] at t - shift; steps of dry friction come where the velocity of then turns."""
    total, speed = torques.total[:, joints], motion.dq[:, joints]
    if torques.dry is None:
        return delayed(total, motion, shift)
    dry = torques.dry[:, joints]
    smooth = delayed(total - dry, motion, shift)
    level = delayed(dry * np.sign(speed), motion, shift)
    return smooth + level * np.sign(delayed(speed, motion, shift))
