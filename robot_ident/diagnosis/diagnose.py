"""Which physical effect is missing: found by what predicts a motion that it has not seen.

Once a model misfits, almost every column is significant, so significance decides only whether something is missing.
What is missing is decided by held-out prediction: the true cause keeps its coefficient on another trajectory, a
likeness's changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis, Finding, Tell, silent
from robot_ident.diagnosis.drift import without_trends
from robot_ident.diagnosis.selection.diagnosis_of import diagnosis_of
from robot_ident.estimation.declaration import clock_notes
from robot_ident.estimation.validation import refuse_foreign
from robot_ident.model.model import is_poor
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import of_one_motion, refuse_copies, refuse_silent
from robot_ident.recording.measurement import Measurement, time_scale_notes
from robot_ident.regression.evidence import Evidence, gather
from robot_ident.regression.hidden_path import note
from robot_ident.regression.misfit import misfit
from robot_ident.regression.weighed_by_residual import tells_noise
from robot_ident.signals.motion import Array


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


def with_hidden_rest(found: Diagnosis, evidence: Evidence) -> Diagnosis:
    """Return a diagnosis with the joints at which an adequate model doesn't fit as it stands, and a note.

    evidence: on the model as it was given, not whitened: judged as `compare` judges.
    """
    if found.verdict != "adequate":
        return found
    robot = evidence.structure.robot
    phi = np.concatenate([columns.reshape(-1, columns.shape[2]) for columns in evidence.phi])
    tests = misfit(evidence, np.linalg.pinv(phi.T @ phi, hermitian=True))
    joints = tuple(name for name, test in zip(robot.joints, tests, strict=True) if test.fails)
    if not joints:
        return found
    return replace(found, notes=(*found.notes, note(joints)), hidden_in_path=joints)


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
    left = tuple(one for one in found.missing if one not in [finding for finding, _ in useless])
    others: tuple[Finding, ...] = (*(finding for finding, _ in useless), *found.others)
    notes = (*found.notes, *(note for _, note in useless))
    return replace(found, verdict="missing" if left else "unexplained", missing=left, others=others, notes=notes)


def _mean_squares(measured: Measurement) -> Array:
    """Return the mean square torque [n] of the rows that count, as it is compared."""
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    return np.asarray(np.sum(torque**2 * used, axis=0) / np.maximum(used.sum(axis=0), 1))
