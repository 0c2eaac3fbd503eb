"""Dry friction of what is moved through a play."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Course, Effect, Inner, Mathematics, Signals, Torques
from robot_ident.effects.hysteresis import behind_play, since_reversal
from robot_ident.signals.motion import Array, Motion

_EDGE = 0.15  # of the gap: how sharply the smooth stand-in tells its end


class FrictionBehindPlay(Effect):
    """A slide, a seal or a spindle's nut that is dragged through a clearance: after a reversal its friction is gone
    until the joint has crossed the gap, and then rises, Fc z with z = 0 on the way and z = sign(dq) in sliding.

    It is an elastic element that slides (`presliding`), with a dead zone: z = clip((|d| - gap / 2) / rise, 0, 1)
    sign(d), where d follows q within |d| <= gap / 2 + rise (play operator; Brokate and Sprekels, "Hysteresis and phase
    transitions", 1996). `rise` is given as a share of the gap. The column is z - sign(dq), which is zero in sliding:
    Coulomb friction stays its level, `level` is the part of it behind the play. A periodic motion runs to its steady
    state, another one starts in the middle of the gap.
    """

    name = "friction_behind_play"
    equation = "Fc (z - sign(dq)), z = 0 within the gap after a reversal, then up to sign(dq) over rise x gap"
    meaning = "friction behind a play: missing until the gap is crossed after a reversal"
    coefficients = (Coefficient("level", "Nm", "N", positive=True),)
    inner = (
        Inner(
            "gap",
            "rad",
            "m",
            1e-4,
            0.1,
            (0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.06),
            (2e-4, 5e-4, 0.001, 0.002, 0.005, 0.01, 0.02),
            logarithmic=True,
            defining=True,
        ),
        Inner("rise", "", "", 0.005, 1.0, (0.03, 0.25), logarithmic=True),
    )
    symmetry = "memory"
    signature = "a step of torque some way after a reversal"
    confused_with = ("presliding", "backlash", "time_delay", "coulomb")
    experiment = "reversals that go back by more and by less than the gap: within it the friction stays away"
    magnitude = "up to Fc over 1-50 mrad after reversals: 5-35 / 0.2-2 Nm"
    more_than = "presliding"
    needs_time = True
    symbolic = False
    brief = True

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return z - sign(dq) along the path."""
        gap = self.setting["gap"]
        z = behind_play(motion.q[:, self.joint], gap, self.setting["rise"] * gap, motion.periodic)
        out = np.zeros((motion.samples, self.robot.n, 1))
        out[:, self.joint, 0] = z - np.sign(motion.dq[:, self.joint])
        return out

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return z - sign(dq) as it is after a reversal from full sliding."""
        gap, rise = self.setting["gap"], self.setting["rise"]
        onward, path, begun = since_reversal(self, x, m, rise * gap)
        unloads = (m.fabs(1.0 - path) + (1.0 - path)) / 2.0
        within = 0.5 * (1.0 - m.tanh((rise * path - 1.0 - 1.5 * rise) / max(_EDGE, 0.5 * rise)))
        return [{self.joint: -onward * begun * (within + unloads)}]
