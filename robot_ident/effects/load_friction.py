"""Friction that grows with what the gear carries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals

_LOAD, _DRIVE = 0.0, 1.0  # forms; where none is given, the middle of the grid is taken: the load
_LOCKS = 0.5  # of what the drive gives: a gear that loses more can't be driven back


class LoadFriction(Effect):
    """Losses of a gear in proportion to the torque that it carries: tau = (c sign(dq) + b dq) |tauL| (Hamon, Gautier
    and Garrec 2010; transmission efficiency).

    `form` 0 takes the links' torque for that; form 1 all that the drive gives, friction before the teeth included:
    that has an even part in time, too. An efficiency that differs between driving and driven differs from form 0 by a
    share of the load itself, which the inertial parameters hold.
    """

    name = "load_friction"
    equation = "(c sign(dq) + b dq) |tauL| (form 0), or |tau| for |tauL| (form 1)"
    meaning = "friction in proportion to the gear's load"
    coefficients = (
        Coefficient("coulomb", "Nm/Nm", "N/N", positive=True, largest=_LOCKS),
        Coefficient("viscous", "s/rad", "s/m"),
    )
    inner = (Inner("form", "", "", 0.0, 1.0, (_DRIVE, _LOAD), continuous=False),)
    symmetry = "dissipative"
    signature = "a butterfly over load"
    confused_with = ("position_friction", "torque_saturation")
    experiment = "the same motion with and without a payload: load friction grows with it"
    magnitude = "2-12 % of the load / the same"
    uses_torque = True

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq) and dq times what the gear carries."""
        torque, v = x.total if self.setting["form"] == _DRIVE else x.load, x.dq[self.joint]
        carried = m.fabs(torque[self.joint])
        return [{self.joint: m.sign(v) * carried}, {self.joint: v * carried}]
