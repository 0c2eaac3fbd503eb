"""Which physical effect is missing: found by what predicts a motion that it has not seen.

Once a model misfits, almost every column is significant, so significance decides only whether something is missing.
What is missing is decided by held-out prediction: the true cause keeps its coefficient on another trajectory, a
proxy's changes. Effects are added one by one, each chosen on what the earlier ones leave, and the earlier ones are
chosen again in its light.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from robot_ident.diagnosis.by_prediction import diagnose_by_prediction
from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect, Verdict
from robot_ident.diagnosis.drift import DRIFT, UNSEEN_IN_MEANS, drift_suspect, drift_tests, without_trends
from robot_ident.diagnosis.evidence import Evidence, extended, gather, split
from robot_ident.diagnosis.hidden_rest import with_hidden_rest
from robot_ident.diagnosis.impossible import of_use, possible
from robot_ident.diagnosis.lack_of_fit import LackOfFit, lack_of_fit
from robot_ident.diagnosis.measuring.first import Fault, measuring_fault, undecidable
from robot_ident.diagnosis.measuring.jitter import with_jitter
from robot_ident.diagnosis.power import too_little, unseen_below, with_doubt
from robot_ident.diagnosis.progress import Tell, silent
from robot_ident.diagnosis.scan import base_gram
from robot_ident.diagnosis.search import Search
from robot_ident.diagnosis.selection.diagnosis_of import diagnose_by_sets
from robot_ident.diagnosis.spectrum import whitened
from robot_ident.diagnosis.stage import GAIN, MOSTLY, Stage
from robot_ident.diagnosis.suspects import Ground, further, gap_suspects, suspect
from robot_ident.diagnosis.unexplained import doubted, explain_by_variables, of_another_form, stiction_note
from robot_ident.diagnosis.unseen import Unseen
from robot_ident.diagnosis.weighed_by_residual import tells_noise
from robot_ident.estimation.declaration import clock_notes
from robot_ident.estimation.validation import refuse_foreign
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import of_one_motion, refuse_copies, refuse_silent
from robot_ident.recording.measurement import Measurement, time_scale_notes
from robot_ident.signals.motion import Array

SHARE = 0.35  # of a joint's excess that its members must explain on trajectories not seen
STRICTER = 0.37  # more than that where what remains is seen beside the noise: a proxy leaves much, a cause little
_SEEN = 0.25  # of the noise of the mean: what remains is seen as clearly as need be
_SURE = 60.0  # decades of its p-value, that are as clear
_SHADOW = 0.2  # of what another joint still lacks, that a member must explain: less may be the shadow of that
Procedure = Literal["rules", "sets"]
ALONE = 0.4  # of its held-out gain that any other effect may reach, where there is one recording only


def diagnose(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
    *,
    as_declared: bool = False,
    procedure: Procedure = "rules",
) -> Diagnosis:
    """Return what is missing from a model, judged on several periodic recordings.

    validation: measurements that never enter a fit; what a candidate predicts of them is evidence. Where a recording
    doesn't tell its noise, all are judged by prediction alone, and none can be called adequate. tell: hears how far it
    has come. as_declared: go on where efforts are none of these motions, or weight is that of another gravity than
    declared; otherwise these raise InputError. procedure: `rules` adds one effect after the other; `sets` searches sets
    of effects and tells a probability with each, without faults of measuring but gain and filter of an effort.
    """
    refuse_copies([*measurements, *validation])
    if not as_declared:
        refuse_foreign([*measurements, *validation], structure.robot)
    refuse_silent(measurements, "; a model of the others alone: identify --joints {moving}")
    if not all(tells_noise(measured) for measured in measurements):
        by = diagnose_by_sets if procedure == "sets" else diagnose_by_prediction
        predicted = of_use(by(measurements, structure, validation, tell), measurements)
        notes = [*_unknown_noise(measurements), *predicted.notes, *time_scale_notes(measurements)]
        return replace(predicted, notes=tuple(notes)).seen_by(structure.robot)
    clock = "; ".join(clock_notes(measurements, structure.robot))
    notes = time_scale_notes(measurements)
    trending = {effect.label for effect in structure.effects if effect.trends}
    measurements, structure, validation = without_trends(measurements, structure, validation)
    plain = gather(measurements, structure)
    notes += _told_less_well(measurements)
    if procedure == "sets":
        found = diagnose_by_sets(measurements, structure, validation, tell)
        found = replace(found, notes=(*found.notes, *notes))
    else:
        found = _by_rules(plain, validation, trending, notes, tell)
    return replace(of_use(with_hidden_rest(found, plain), measurements), clock=clock).seen_by(structure.robot)


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


def _by_rules(
    plain: Evidence,
    validation: Sequence[Measurement],
    trending: Collection[str],
    notes: Sequence[str],
    tell: Tell,
) -> Diagnosis:
    """Return what is missing, one effect added after the other; plain: evidence that is not whitened."""
    # lines belong to a whole period: of its parts, the rows are weighed
    evidence = whitened(plain) if len(plain.trajectories) > 1 else split(plain)
    tell(0.05, "trying every effect")
    blind = Stage.of(evidence)
    tell(0.3, "looking for faults of what is measured")
    judged = measuring_fault(evidence, blind.folds, blind.scores, validation)
    if judged.fault is not None:
        return with_doubt(_fault_first(evidence, blind, judged.fault, validation, notes), evidence)
    unseen = Unseen.of(validation, evidence)
    searched = Search(evidence, blind if unseen is None else Stage.of(evidence, unseen)).run(tell)
    tell(0.8, "weighing what was found")
    notes = [*notes, *undecidable(evidence, blind.folds)]
    found_all = judged.low_passes.beside(_conclude(evidence, searched, validation, notes, trending))
    return with_doubt(with_jitter(found_all, evidence), evidence)


def _fault_first(
    evidence: Evidence, first: Stage, fault: Fault, validation: Sequence[Measurement], notes: Sequence[str]
) -> Diagnosis:
    """Return a fault of what is measured as what has to be put right first."""
    failing = [j for j, fit in enumerate(first.fits) if fit.fails]
    others = further(Ground(evidence, first, (), validation), (), failing)
    found = Diagnosis("missing", (fault.suspect,), tuple(others), fault.remaining, None, (*notes, fault.note))
    return with_jitter(found, evidence)


def _conclude(
    whole: Evidence,
    found: Search,
    validation: Sequence[Measurement],
    notes: Sequence[str],
    trending: Collection[str],
) -> Diagnosis:
    """Weigh what was found against what remains, and put it into words and figures; trending: in the model already."""
    robot, members, first = whole.structure.robot, found.members, found.first
    failing = [j for j, fit in enumerate(found.given.fits) if fit.fails]
    failing += [j for m in members for j in m.columns.joints if j not in failing and m.held_out_by_joint[j] >= GAIN / 2]
    shown = [j for j, name in enumerate(robot.joints) if f"{DRIFT}@{name}" not in trending]
    drifting = {j: test for j, test in enumerate(drift_tests(whole)) if test.told and j in shown}
    trusted = _trusted(found, failing)
    why = doubted(trusted, first, found.last)
    trusted, against = possible([m for m in trusted if m.label not in why], whole)
    notes = [*notes, *why.values(), *against, *of_another_form(trusted, first, found.last)]
    gaps = gap_suspects(whole, trusted, list(found.gaps.values()), validation)
    suspects = [*(suspect(_ground(whole, found, gaps, validation), m, trusted) for m in trusted), *gaps]
    held = [s.effect for s in suspects]
    with_all = extended(whole, held) if held else whole
    drifts = [drift_suspect(with_all, j, test, validation) for j, test in drifting.items()]
    suspects += drifts
    notes = [*notes, *(f"{one.label}: {UNSEEN_IN_MEANS}" for one in drifts)]
    fits = lack_of_fit(with_all, base_gram(with_all))
    verdict: Verdict = "missing" if suspects else "unexplained" if failing else "adequate"
    if verdict == "unexplained":
        more = too_little(first.scores, whole, failing)
        verdict, notes = ("not_decidable", [*notes, more]) if more else (verdict, notes)
    elif verdict == "adequate":
        notes = [*notes, unseen_below(whole)]
    others = further(_ground(whole, found, gaps, validation), {s.label for s in suspects}, failing)
    open_joints = [j for j, fit in enumerate(fits) if fit.fails and j not in found.rattling]
    worst = max(open_joints, key=lambda j: fits[j].statistic, default=None)
    rest = None if worst is None else explain_by_variables(with_all, worst)
    if rest is not None and verdict == "unexplained":
        notes = [*notes, *stiction_note(rest, with_all)]
    return Diagnosis(
        verdict,
        tuple(suspects),
        tuple(others),
        {name: float(np.sqrt(fit.excess)) for name, fit in zip(robot.joints, fits, strict=True)},
        rest,
        tuple(notes),
    )


def _ground(whole: Evidence, found: Search, gaps: Sequence[Suspect], validation: Sequence[Measurement]) -> Ground:
    return Ground(whole, found.first, tuple(gap.effect for gap in gaps), validation)


def _trusted(found: Search, failing: Sequence[int]) -> list[Score]:
    """Return the members that, all together, explain more than needed of the excess on a joint that they are made for.

    As much as the least that is wanted, and more the farther what remains stands above the noise of the mean; on
    trajectories left out in turn or on recordings kept aside. What another joint lacks far more of casts its shadow on
    the rest, through the inertia: beside it nothing small is trusted.
    """
    first, last = found.first, found.last
    share = (first.loss - last.loss) / np.maximum(first.surely, GAIN)
    if first.unseen_excess is not None and last.unseen_excess is not None:
        aside = 1.0 - last.unseen_excess / np.maximum(first.unseen_excess, 1e-300)
        share = np.where(first.unseen_excess >= GAIN, np.maximum(share, aside), share)
    surplus = share - SHARE - STRICTER * np.array([_seen(fit) for fit in last.fits])

    def enough(member: Score) -> bool:
        joints = [j for j in member.mainly if j in failing]
        if not joints or float(np.max(surplus[joints])) < 0.0:
            return False
        elsewhere = np.delete(last.excess, list(member.columns.joints))
        return float(member.held_out_by_joint[joints].sum()) >= _SHADOW * float(elsewhere.max(initial=0.0))

    return [m for m in found.members if enough(m) or _stands_out(m, first, share)]


def _seen(fit: LackOfFit) -> float:
    """Return how clearly it is seen that something remains on a joint, 0 to 1."""
    if not fit.fails:
        return 0.0
    decades = -float(np.log10(max(fit.p_value, 1e-300)))
    return float(np.clip(max((fit.statistic - 1.0) / _SEEN, decades / _SURE), 0.0, 1.0))


def _stands_out(member: Score, first: Stage, share: Array) -> bool:
    """Return whether, of one recording alone, an effect explains most of the excess and no other comes near it.

    Parts left out of one motion are extrapolated to, so that even a cause doesn't explain them whole.
    """
    if len(first.evidence.recordings) > 1:
        return False
    joints = list(member.columns.joints)
    mine = next((s.held_out for s in first.scores if s.label == member.label), 0.0)
    rivals = [s.held_out for s in first.scores if s.label != member.label and set(s.columns.joints) & set(joints)]
    return float(np.max(share[joints])) >= MOSTLY and max(rivals, default=0.0) <= ALONE * mine
