"""Friction that grows with what the gear carries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import DRIVE_SIDE, Coefficient, Effect, Mathematics, Signals


class LoadFriction(Effect):
    """Losses of a gear in proportion to the torque that it carries: tau = (c sign(dq) + b dq) |tauL| (Hamon, Gautier
    and Garrec 2010; transmission efficiency).
    """

    name = "load_friction"
    equation = "(c sign(dq) + b dq) |tauL|"
    meaning = "friction in proportion to the gear's load"
    coefficients = (Coefficient("coulomb", "Nm/Nm", "N/N", positive=True), Coefficient("viscous", "s/rad", "s/m"))
    symmetry = "dissipative"
    signature = "a butterfly over load"
    confused_with = ("position_friction", "torque_saturation")
    experiment = "the same motion with and without a payload: load friction grows with it"
    magnitude = "2-12 % of the load / the same"
    seen_from = DRIVE_SIDE
    uses_torque = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq) |tauL| and dq |tauL|."""
        load, v = m.fabs(x.load[self.joint]), x.dq[self.joint]
        return [{self.joint: m.sign(v) * load}, {self.joint: v * load}]
