"""Effort that the driver has low-passed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.signals.derivatives import lagged
from robot_ident.signals.filters import driven
from robot_ident.signals.motion import Array, Motion


class EffortFilter(Effect):
    """A low pass over the effort and not over the position, of one joint or, without `@JOINT`, of all joints alike.

    The column is (F[tau] - tau) / T of a low pass F that is T late, so that its coefficient is T itself. Of first
    order: T dF/dt + F = tau. Of second order (Butterworth): T^2/2 d2F/dt2 + T dF/dt + F = tau. `diagnose` then takes
    the exact frequency, and tries moving averages and filters computed from sample to sample as well.
    """

    name = "effort_filter"
    equation = "lag (F[tau] - tau) / T"
    meaning = "low pass over the effort alone"
    coefficients = (Coefficient("lag", "ms", "ms", positive=True),)
    inner = (
        Inner("T", "s", "s", 0.002, 0.1, (0.005, 0.01, 0.02, 0.04), logarithmic=True, defining=True),
        Inner("order", "", "", 1.0, 2.0, (1.0, 2.0), continuous=False),
    )
    symmetry = "memory"
    signature = "over the rate of torque; the steps of dry friction come rounded"
    confused_with = ("time_delay", "presliding")
    experiment = "read the drive's raw current beside the filtered one; a delay keeps the steps of dry friction sharp"
    magnitude = "3-30 Hz: 5-50 ms"
    scope = "joint_or_robot"
    uses_torque = True
    needs_time = True
    symbolic = False
    regression = False
    measuring = True
    evidence = "the model's torque behind a low pass follows the effort better than with any effect, on unseen motion"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return (F[tau] - tau) / T, Nm per ms."""
        out = np.zeros((motion.samples, self.robot.n, 1))
        if torques is None:
            return out
        joints = slice(None) if self.whole else slice(self.joint, self.joint + 1)
        span, total = self.setting["T"], torques.total[:, joints]
        passed = lagged(total, motion, span) if self.setting["order"] == 1.0 else _second_order(total, motion, span)
        out[:, joints, 0] = (passed - total) / (1000.0 * span)
        return out

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return the same along smooth motion: -dtau/dt + T d2tau/dt2, of second order half of the latter."""
        joints = range(self.robot.n) if self.whole else (self.joint,)
        bend = self.setting["T"] / self.setting["order"]
        out = {}
        for j in joints:
            rate = course.rate(x.total[j])
            out[j] = (bend * course.rate(rate) - rate) / 1000.0
        return [out]


def _second_order(torque: Array, motion: Motion, lag: float) -> Array:
    """Return torque [N, k] behind a Butterworth filter of second order that is `lag` [s] late."""
    one = np.ones(motion.samples)
    inertia, damping = 0.5 * lag**2 * one, lag * one
    return np.stack([driven(motion, column, inertia, damping, one)[0] for column in torque.T], axis=1)
