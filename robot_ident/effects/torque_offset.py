"""Constant torque: a current sensor's bias or Coulomb friction that differs by direction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals


class TorqueOffset(Effect):
    """A constant: tau = t0. No motion can tell a sensor bias from asymmetric Coulomb friction: the column is the
    same.
    """

    name = "torque_offset"
    equation = "t0"
    meaning = "constant torque (sensor bias, or Coulomb friction that differs by direction)"
    coefficients = (Coefficient("torque_offset", "Nm", "N"),)
    symmetry = "conservative"
    exact = True
    signature = "a constant"
    confused_with = ("cable", "viscous_asymmetric")
    also_like = ("a current sensor's bias: the same column",)
    magnitude = "1-8 / 0.1-1 Nm"
    experiment = "read the current with the drives off; no motion can tell"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return 1."""
        return [{self.joint: 1.0 + 0.0 * x.q[self.joint]}]
