"""Effects that only a coefficient of the impossible sign would explain: no rotor has an inertia below zero.

Such a column follows what is left over, and stands in for something else: a clock that runs wrong or an effort of a
wrong gain put inertia and weight out of proportion, which only some of the columns can follow.
"""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.diagnosis.before_after import estimates
from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.effects import Effect
from robot_ident.estimation.driving import POSITIVE

_SURE = 2.0  # standard deviations below zero of an effect that is to be named: it stands far from it anyway

_HINTS = {"rotor_inertia": "; an impossible inertia points at a clock that runs wrong, or at the gain of an effort"}


def possible(members: Sequence[Score], whole: Evidence) -> tuple[list[Score], list[str]]:
    """Return the members whose coefficients, fitted all together, can be what they are, and a note on each other one.

    whole: evidence on the model as it was given.
    """
    kept, notes = list(members), []
    while kept:
        together = extended(whole, [member.effect for member in kept])
        below = [(_below_zero(m.effect, estimates(together, m.effect)), m) for m in kept if _has_sign(m.effect)]
        found = [(told, m) for told, m in below if told is not None]
        if not found:
            break
        told, worst = min(found, key=lambda pair: pair[0].value / pair[0].std)
        kept = [m for m in kept if m is not worst]
        hint = _HINTS.get(worst.effect.name, "; it stands in for something else")
        notes.append(
            f"{worst.label} is not named: it would need {told.in_words}, and none below zero is possible{hint}"
        )
    return kept, notes


def _signs(effect: Effect) -> list[bool]:
    return [least == 0.0 or effect.name in POSITIVE for least, _ in effect.ranges]


def _has_sign(effect: Effect) -> bool:
    return any(_signs(effect))


def _below_zero(effect: Effect, told: Sequence[Estimate]) -> Estimate | None:
    """Return the coefficient of an effect that is farthest below zero where it can't be, or None."""
    linear = zip(_signs(effect), told, strict=False)
    wrong = [one for positive, one in linear if positive and one.value < -_SURE * one.std and one.std > 0]
    return min(wrong, key=lambda one: one.value / one.std, default=None)
