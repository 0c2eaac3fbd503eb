"""Effects of one's own, for any verb that knows effects: robot_ident VERB ... --effects-from examples/my_effects.py.

A class states what it is as data and writes its torque per unit of each coefficient once, in `full_terms`. From that
follow its columns, the fit with uncertainty, the search of its inner parameters, its place among the candidates of
`diagnose` and what `robot_ident effects tight_spot` prints. (An effect that depends on the past writes `full_columns`
instead, from the whole motion, and sets `needs_time = True` and `symbolic = False`.)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects import Coefficient, Effect, Inner, Mathematics, Signals


class TightSpot(Effect):
    """Dry friction that is larger around one position, as where a seal rubs."""

    name = "tight_spot"
    equation = "f sign(dq) exp(-((q - q0) / w)^2)"
    meaning = "friction of a tight spot at q0, w wide"
    coefficients = (Coefficient("level", "Nm", "N", positive=True),)
    inner = (
        Inner("q0", "rad", "m", -3.2, 3.2, grid=(-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9)),
        Inner("w", "rad", "m", 0.02, 1.0, grid=(0.05, 0.15), logarithmic=True),
    )
    symmetry = "dissipative"
    signature = "odd in velocity, near one position alone"
    confused_with = ("position_friction",)
    experiment = "a slow sweep over the whole range in both directions"
    magnitude = "2-20 / 0.2-2 Nm"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return sign(dq) exp(-((q - q0) / w)^2); `m` holds the functions of numpy or of CasADi."""
        q, dq = x.q[self.joint], x.dq[self.joint]
        away = (q - self.setting["q0"]) / self.setting["w"]
        return [{self.joint: m.sign(dq) * m.exp(-(away**2))}]
