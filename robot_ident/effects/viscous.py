"""Viscous friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals


class Viscous(Effect):
    """Friction in proportion to speed: tau = b dq (Swevers et al. 1997, parameters 16 to 18)."""

    name = "viscous"
    equation = "b dq"
    meaning = "viscous friction"
    coefficients = (Coefficient("viscous", "Nm s/rad", "N s/m", positive=True),)
    symmetry = "dissipative"
    signature = "over velocity, odd"
    confused_with = ("viscous_nonlinear", "temperature_drift")
    experiment = "constant speeds over the whole range: their torques lie on a straight line"
    magnitude = "5-50 / 0.5-5 Nm s/rad"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return dq."""
        return [{self.joint: x.dq[self.joint]}]
