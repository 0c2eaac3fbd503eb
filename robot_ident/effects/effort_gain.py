"""Effort in a wrong unit, or with a wrong sign."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals


class EffortGain(Effect):
    """A joint's effort that is reported g times too large: a gear ratio, a torque constant or a sign that is wrong.

    All of a joint's row is multiplied, and its own parameters with it. The error shows where the row shares parameters
    with other joints' rows: the links that both carry. A joint that shares none says nothing of its gain.
    """

    name = "effort_gain"
    equation = "(g - 1) tau"
    meaning = "effort reported too large or too small by a factor, or with the wrong sign"
    coefficients = (Coefficient("excess", "%", "%"),)
    symmetry = "mixed"
    signature = "over torque, and torque of the links that other joints' rows contradict"
    confused_with = ("load_friction", "torque_saturation")
    experiment = "hold a known payload: its weight must show with the same mass at every joint that carries it"
    magnitude = "5-60 % and signs"
    uses_torque = True
    regression = False
    measuring = True
    evidence = "with the joint's row multiplied the joints' shares in common parameters agree, on unseen motion as well"

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return tau / 100."""
        return [{self.joint: x.total[self.joint] / 100.0}]
