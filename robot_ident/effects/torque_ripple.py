"""Torque that ripples with the motor's turns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals
from robot_ident.robot.robot import Robot


class TorqueRipple(Effect):
    """Cogging, current-sensor and gear ripple in step with the motor's angle n q, n the gear ratio: tau = a cos(h n q)
    + b sin(h n q).

    h = 2 is a strain-wave gear's wave generator, h = 1 an eccentric motor, 1/2 and 4 their neighbours. Behind the gear
    the drive's own ripple doesn't show, but that of strain gauges on a flexspline does, which the wave generator bends.
    """

    name = "torque_ripple"
    equation = "a cos(h n q) + b sin(h n q), n the gear ratio"
    meaning = "torque ripple of motor and gear"
    coefficients = (Coefficient("cos", "Nm", "N"), Coefficient("sin", "Nm", "N"))
    inner = (Inner("h", "", "", 0.5, 4.0, (0.5, 1.0, 2.0, 4.0), continuous=False),)
    symmetry = "conservative"
    signature = "lines whose frequency moves with speed"
    also_like = ("a disturbance of fixed frequency",)
    confused_with = ("encoder_eccentricity",)
    experiment = "two speeds: ripple's frequency follows the speed, a disturbance's stays"
    magnitude = "1-6 / 0.1-1 Nm"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Know the gear ratio."""
        if joint is not None and robot.drives.gear_ratio[joint] != 1.0:
            return None
        return f"robot {robot.name} gives no gear_ratio for this joint (joints: in a robot YAML)"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return cos(h n q) and sin(h n q)."""
        angle = self.setting["h"] * float(self.robot.drives.gear_ratio[self.joint]) * x.q[self.joint]
        return [{self.joint: m.cos(angle)}, {self.joint: m.sin(angle)}]
