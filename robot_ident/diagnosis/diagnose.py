"""Which physical effect is missing: found by what predicts a motion that it has not seen.

Once a model misfits, almost every column is significant, so significance decides only whether something is missing.
What is missing is decided by held-out prediction: the true cause keeps its coefficient on another trajectory, a
likeness's changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.diagnosis.drift import without_trends
from robot_ident.diagnosis.hidden_rest import with_hidden_rest
from robot_ident.diagnosis.of_use import of_use
from robot_ident.diagnosis.progress import Tell, silent
from robot_ident.diagnosis.selection.diagnosis_of import diagnosis_of
from robot_ident.estimation.declaration import clock_notes
from robot_ident.estimation.validation import refuse_foreign
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import of_one_motion, refuse_copies, refuse_silent
from robot_ident.recording.measurement import Measurement, time_scale_notes
from robot_ident.regression.evidence import gather
from robot_ident.regression.weighed_by_residual import tells_noise


def diagnose(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
    *,
    as_declared: bool = False,
) -> Diagnosis:
    """Return what is missing from a model, as the set of effects that predicts motion which was not fitted best.

    An effect is named at a probability of .8 and more; below, it is listed, and the verdict is `not_decidable` where
    nothing else is named. validation: measurements that never enter a fit; what an effect predicts of them is evidence.
    Where a recording doesn't tell its noise, none can be called adequate. tell: hears how far it has come. as_declared:
    go on where efforts are none of these motions, or weight is that of another gravity than declared; otherwise these
    raise InputError.
    """
    refuse_copies([*measurements, *validation])
    if not as_declared:
        refuse_foreign([*measurements, *validation], structure.robot)
    refuse_silent(measurements, "; a model of the others alone: identify --joints {moving}")
    if not all(tells_noise(measured) for measured in measurements):
        found = diagnosis_of(measurements, structure, validation, tell)
        notes = [*_unknown_noise(measurements), *found.notes, *time_scale_notes(measurements)]
        return of_use(replace(found, notes=tuple(notes)), measurements).seen_by(structure.robot)
    clock = "; ".join(clock_notes(measurements, structure.robot))
    notes = [*time_scale_notes(measurements), *_told_less_well(measurements)]
    measurements, structure, validation = without_trends(measurements, structure, validation)
    found = diagnosis_of(measurements, structure, validation, tell)
    found = with_hidden_rest(replace(found, notes=(*found.notes, *notes)), gather(measurements, structure))
    return replace(of_use(found, measurements), clock=clock).seen_by(structure.robot)


def _unknown_noise(measurements: Sequence[Measurement]) -> list[str]:
    """Return which recordings do not tell their noise, and what follows from it."""
    silent = ", ".join(measured.source for measured in measurements if not tells_noise(measured))
    notes = [
        f"{silent}: without periods the noise is unknown: nothing can be called adequate, what remains includes the"
        " noise, and effects are judged by the error on data left out; record 8 or more periods of a motion for a floor"
    ]
    if len(measurements) < 2:
        notes.append(
            "one recording only: judged by parts of its own motion, which tells causes from proxies less well;"
            " record another motion"
        )
    return notes


def _told_less_well(measurements: Sequence[Measurement]) -> list[str]:
    """Return why recordings tell causes from proxies less well than others would."""
    if len(measurements) == 1:
        of = "one trajectory only: judged by parts of its own motion"
    elif of_one_motion(measurements):
        of = "all recordings are of one motion: what is left out of one is seen in another"
    else:
        return []
    return [f"{of}, which tells causes from proxies less well; record another motion"]
