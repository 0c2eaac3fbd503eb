"""Friction that bends with speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any, Self

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.signals.motion import Array, Motion

_STILL = 1e-12  # (rad/s)^2 that keep the derivative of |v|^p finite at standstill
_POWERS = (0.6, 1.5, 2.0, 3.0)
_BENT = (0.1, 0.8), (1.25, 4.0)  # powers that bend: f |v|^p beside b v tells (p - 1) f alone where p comes near 1
_FALLS = 0.05  # of what friction falls and rises by over the speed: the error of its formula
_POWER, _TANH = 0.0, 1.0


class ViscousNonlinear(Effect):
    """Friction that isn't in proportion to speed, in one of two forms: f sign(dq) |dq|^p (churned lubricant, thinned by
    shear) or f tanh(dq / v0) (Coulomb friction that sets in gradually).

    `form` 0 is the power, whose exponent is `bend`; form 1 is the tanh, whose speed v0 is `bend`. What sets in at low
    speed (the tanh, powers below 1) rises with speed, f >= 0: a friction that falls there is Stribeck's.
    """

    name = "viscous_nonlinear"
    equation = "f sign(dq) |dq|^bend (form 0), or f tanh(dq / bend) (form 1)"
    meaning = "friction that bends with speed"
    coefficients = (Coefficient("level", "Nm", "N"),)
    inner = (
        Inner("form", "", "", 0.0, 1.0, (_POWER, _TANH), continuous=False),
        Inner(
            "bend",
            "1, or rad/s",
            "1, or m/s",
            0.002,
            4.0,
            (0.03, 0.06, 0.12, 0.25, 0.5, 1.0),
            (0.004, 0.008, 0.016, 0.03, 0.06, 0.12),
            logarithmic=True,
        ),
    )
    symmetry = "dissipative"
    signature = "a bend in the friction curve"
    confused_with = ("stribeck", "temperature_drift")
    experiment = "constant speeds over a wider range, slowest and fastest included"
    magnitude = "2-15 / 0.5-5 Nm at full speed"

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return exponents for the power and speeds for the tanh."""
        speeds = self.inner[1].grid
        return [{"form": _POWER, "bend": p} for p in _POWERS] + [{"form": _TANH, "bend": v} for v in speeds]

    def at(self, setting: Mapping[str, float]) -> Self:
        """Return the same effect with other inner parameters; a power stays on its side of 1."""
        other = super().at(setting)
        form, bend = type(self).inner
        power = other.setting["bend"]
        sides = _BENT if other.setting["form"] == _POWER else ()
        low, high = next((side for side in sides if side[0] <= power <= side[1]), (bend.lower, bend.upper))
        other.inner = (form, replace(self.inner[1], lower=low, upper=high))
        return other

    def contradicts_itself(
        self, values: Array, along: Sequence[tuple[Motion, Torques]], beside: Mapping[str, float]
    ) -> bool:
        """Return whether friction falls as a joint begins to move, b v + f v^p beside a viscous coefficient b < 0, by
        more than a share of all that it changes by: that is Stribeck's.
        """
        power, (level,) = self.setting["bend"], values
        viscous = beside.get(f"viscous@{self.place}", 0.0)
        if self.setting["form"] != _POWER or power <= 1.0 or level <= 0.0 or viscous >= 0.0:
            return False
        fastest = max((float(np.abs(motion.dq[:, self.joint]).max()) for motion, _ in along), default=0.0)
        slowest = min((-viscous / (level * power)) ** (1.0 / (power - 1.0)), fastest)  # where friction is least
        least, most = (viscous * v + level * v**power for v in (slowest, fastest))
        return bool(-least > _FALLS * (most - 2.0 * least))

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """Only what bends at high speed may bend either way."""
        bends_down = self.setting["form"] == _TANH or self.setting["bend"] < 1.0
        return ((0.0, inf),) if bends_down else super().ranges

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return the column of the chosen form."""
        v, bend = x.dq[self.joint], self.setting["bend"]
        if self.setting["form"] == _TANH:
            return [{self.joint: m.tanh(v / bend)}]
        return [{self.joint: m.sign(v) * (v**2 + _STILL) ** (bend / 2)}]
