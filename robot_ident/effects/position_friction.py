"""Friction that varies with position."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals


class PositionFriction(Effect):
    """Dry friction that varies around a turn (bent shaft, worn gear): tau = sign(dq) (a cos h q + b sin h q)."""

    name = "position_friction"
    equation = "sign(dq) (a cos(h q) + b sin(h q))"
    meaning = "Coulomb friction that varies with position"
    coefficients = (Coefficient("cos", "Nm", "N"), Coefficient("sin", "Nm", "N"))
    inner = (Inner("h", "1/rad", "1/m", 1.0, 100.0, (1.0, 2.0), (6.0, 12.0, 25.0, 50.0), continuous=False),)
    symmetry = "dissipative"
    signature = "odd in velocity, varies with position"
    confused_with = ("load_friction",)
    experiment = "the same motion with a payload: it stays, where load friction grows"
    magnitude = "8-50 % of Coulomb friction / the same"
    steps = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq) cos(h q) and sign(dq) sin(h q)."""
        s, angle = m.sign(x.dq[self.joint]), self.setting["h"] * x.q[self.joint]
        return [{self.joint: s * m.cos(angle)}, {self.joint: s * m.sin(angle)}]
