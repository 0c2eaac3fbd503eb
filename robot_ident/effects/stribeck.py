"""Friction that falls as a lubricant film builds up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals

_STILL = 1e-12  # (rad/s)^2 that keep the derivative of |v|^d finite at standstill


class Stribeck(Effect):
    """Friction beyond Coulomb's at low speed: tau = f sign(dq) exp(-(|dq| / vs)^d) (Armstrong-Helouvry, Dupont and
    Canudas de Wit 1994).
    """

    name = "stribeck"
    equation = "f sign(dq) exp(-(|dq| / vs)^d)"
    meaning = "Stribeck friction: breakaway beyond the sliding level"
    coefficients = (Coefficient("level", "Nm", "N", positive=True),)
    inner = (
        Inner(
            "vs",
            "rad/s",
            "m/s",
            0.0005,
            0.8,
            (0.01, 0.02, 0.04, 0.08, 0.16, 0.32),
            (0.001, 0.003, 0.01, 0.03, 0.08, 0.2),
            logarithmic=True,
            defining=True,
        ),
        Inner("d", "", "", 0.5, 2.0, (0.5, 1.0, 2.0)),
    )
    symmetry = "dissipative"
    signature = "peaks at low speed"
    confused_with = ("viscous_nonlinear", "presliding", "viscous_asymmetric")
    experiment = "constant speeds from 0.005 to 0.3 rad/s: friction falls as speed rises, wherever the joint stands"
    magnitude = "5-30 / 0.2-3 Nm"
    steps = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq) exp(-(|dq| / vs)^d)."""
        v, vs, d = x.dq[self.joint], self.setting["vs"], self.setting["d"]
        return [{self.joint: m.sign(v) * m.exp(-(((v**2 + _STILL) / vs**2) ** (d / 2)))}]
