"""Friction before a contact slides: a spring that yields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.effects.hysteresis import ELEMENTS, dahl, maxwell_slip, since_reversal
from robot_ident.signals.motion import Array, Motion

_DAHL, _MAXWELL = 0.0, 1.0


class Presliding(Effect):
    """Asperities that bend before they slide: friction Fc z follows the path since the reversal, dz = (sign(dq) - z)
    |dq| / x0 (Dahl 1968; LuGre without its velocity terms), or the mean of elastic elements that slide one after
    another (`form` 1, generalized Maxwell slip; Al-Bender, Lampaert and Swevers 2005).

    The column is z - sign(dq), which is zero in sliding: Coulomb friction stays the sliding level. A periodic motion
    runs to its steady state, another one starts at z = 0.
    """

    name = "presliding"
    equation = "Fc (z - sign(dq)), dz = (sign(dq) - z) |dq| / x0 (form 0) or Maxwell slip (form 1)"
    meaning = "presliding friction: what is not yet built up after a reversal"
    coefficients = (Coefficient("level", "Nm", "N", positive=True),)
    inner = (
        Inner("form", "", "", 0.0, 1.0, (_DAHL, _MAXWELL), continuous=False),
        Inner(
            "x0",
            "rad",
            "m",
            1e-5,
            0.2,
            (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06),
            (5e-5, 1e-4, 2e-4, 5e-4, 0.001, 0.002, 0.005, 0.01),
            logarithmic=True,
            defining=True,
        ),
    )
    symmetry = "memory"
    signature = "loops over position since the reversal"
    confused_with = ("stribeck", "friction_behind_play", "time_delay", "coulomb")
    experiment = "small reversals at two speeds: a scale of position stays, a scale of time moves with speed"
    magnitude = "up to 2 Fc at reversals: 10-70 / 0.5-5 Nm, over 0.5-50 mrad"
    needs_time = True
    symbolic = False
    brief = True

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return z - sign(dq) along the path."""
        law = maxwell_slip if self.setting["form"] == _MAXWELL else dahl
        z = law(motion.q[:, self.joint], self.setting["x0"], motion.periodic)
        out = np.zeros((motion.samples, self.robot.n, 1))
        out[:, self.joint, 0] = z - np.sign(motion.dq[:, self.joint])
        return out

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return z - sign(dq) as it is after a reversal from full sliding."""
        onward, path, begun = since_reversal(self, x, m, self.setting["x0"])
        if self.setting["form"] == _MAXWELL:
            lacks = [(m.fabs(2.0 - path / reach) + (2.0 - path / reach)) / 2.0 for reach in ELEMENTS]
            return [{self.joint: -onward * begun * sum(lacks) / len(lacks)}]
        return [{self.joint: -2.0 * onward * begun * m.exp(-path)}]
