"""Effects that can't be what is missing: of an impossible sign, or beside an error that is no robot's.

No rotor has an inertia below zero. Such a column follows what is left over, and stands in for something else: a clock
that runs wrong or an effort of a wrong gain put inertia and weight out of proportion, which only some of the columns
can follow. Where a model misses most of a joint's torque, and with what would be named still does, efforts and
positions don't belong together, and whatever follows part of the error is no physics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.before_after import estimates
from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.diagnosis import Diagnosis, Estimate, Suspect
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.effects import Effect
from robot_ident.estimation.driving import POSITIVE
from robot_ident.model.model import is_poor
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

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


def of_use(found: Diagnosis, measurements: Sequence[Measurement]) -> Diagnosis:
    """Return a diagnosis without the names at joints of which the model misses most of the torque before and after: rms
    beyond half of that of the torque, which stands above its noise.
    """
    torque = np.mean([_mean_squares(measured) for measured in measurements], axis=0)
    noise = np.mean([measured.averaged_variance for measured in measurements], axis=0)
    told = {
        name: (float(torque[k]), float(noise[k]) if np.isfinite(noise[k]) else None)
        for k, name in enumerate(measurements[0].joints)
    }
    useless = []
    for one in found.missing:
        joint = one.place
        after = found.remaining_rms[joint] ** 2
        if is_poor(one.mse_before[joint], *told[joint]) and is_poor(after, *told[joint]):
            share = (after / told[joint][0]) ** 0.5
            useless.append(
                (
                    one,
                    f"{one.label} is not named: with it the model still misses {100 * share:.0f} % of the"
                    f" torque of {joint}; efforts and positions of that joint don't belong together",
                )
            )
    if not useless:
        return found
    left = tuple(one for one in found.missing if one not in [suspect for suspect, _ in useless])
    others: tuple[Suspect, ...] = (*(suspect for suspect, _ in useless), *found.others)
    notes = (*found.notes, *(note for _, note in useless))
    return replace(found, verdict="missing" if left else "unexplained", missing=left, others=others, notes=notes)


def _mean_squares(measured: Measurement) -> Array:
    """Return the mean square torque [n] of the rows that count, as it is compared."""
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    return np.asarray(np.sum(torque**2 * used, axis=0) / np.maximum(used.sum(axis=0), 1))
