"""Coulomb friction."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals


class Coulomb(Effect):
    """Dry friction against the direction of motion: tau = c sign(dq) (Swevers et al. 1997, parameters 19 to 21)."""

    name = "coulomb"
    equation = "c sign(dq)"
    meaning = "Coulomb friction"
    coefficients = (Coefficient("coulomb", "Nm", "N", positive=True),)
    symmetry = "dissipative"
    signature = "a step at zero velocity"
    confused_with = ("presliding", "stribeck")
    experiment = "constant speeds in both directions, extrapolated to zero"
    magnitude = "5-50 / 0.5-5 Nm"
    steps = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq)."""
        return [{self.joint: m.sign(x.dq[self.joint])}]
