"""Viscous friction that differs by direction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals


class ViscousAsymmetric(Effect):
    """Viscous friction b + a forwards and b - a backwards: tau = a |dq| beside b dq."""

    name = "viscous_asymmetric"
    equation = "a |dq|"
    meaning = "half the difference of viscous friction between the two directions"
    coefficients = (Coefficient("asymmetry", "Nm s/rad", "N s/m"),)
    symmetry = "conservative"
    signature = "over velocity, even"
    confused_with = ("stribeck", "cable", "torque_offset")
    experiment = "two constant speeds in both directions: the difference between directions grows with speed"
    magnitude = "1-5 / 0.1-0.5 Nm s/rad"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return |dq|."""
        return [{self.joint: m.fabs(x.dq[self.joint])}]
