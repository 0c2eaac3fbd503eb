"""Torque constant that falls with current."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import DRIVE_SIDE, Coefficient, Effect, Mathematics, Signals


class TorqueSaturation(Effect):
    """A motor or current sensor that isn't linear: the measured torque differs by a tau |tau| + b tau^3."""

    name = "torque_saturation"
    equation = "a tau |tau| + b tau^3"
    meaning = "torque per ampere that changes with current"
    coefficients = (Coefficient("square", "1/kNm", "1/kN"), Coefficient("cube", "1/(kNm)^2", "1/kN^2"))
    symmetry = "mixed"
    signature = "over torque, not over velocity"
    confused_with = ("load_friction",)
    experiment = "high torque at low speed: holding poses with a payload"
    magnitude = "1-8 % at the peak / the same"
    seen_from = DRIVE_SIDE
    before_sensor = "the motor's current saturates, and the sensor measures no current"
    uses_torque = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return tau |tau| and tau^3 of tau in kNm, as torques in Nm."""
        tau = x.total[self.joint] / 1000.0
        return [{self.joint: 1000.0 * tau * m.fabs(tau)}, {self.joint: 1000.0 * tau**3}]
