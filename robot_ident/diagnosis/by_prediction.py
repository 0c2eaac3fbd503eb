"""Diagnosis of recordings that don't tell their noise: an effect is named where it predicts motion it has not seen.

Without periods there is no noise floor, so nothing says that a model is adequate. What can be said is that an effect
makes the error fall on parts of the recordings that were left out of the fit; what is left is reported as it is, noise
included. Every joint is weighed by the residual that the model leaves on it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.design.discrimination import experiment_between
from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect, Verdict
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.diagnosis.impossible import possible
from robot_ident.diagnosis.left_out import Foreseen, in_parts
from robot_ident.diagnosis.power import with_doubt
from robot_ident.diagnosis.progress import Tell, after, silent
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.ties import tied
from robot_ident.diagnosis.unexplained import explain_by_variables
from robot_ident.diagnosis.weighed_by_residual import weighed_by_residual
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement

FALL = 0.1  # of the squared error on its joints that a member must remove on data left out (5 % of the rms)
AGAIN = 0.2  # the same where a joint has a member already: what an imperfect column leaves looks like another effect
HALVES = 0.02  # the same where a half of one recording predicts the other: what it extrapolates is uncertain
CHANCE = 0.05  # largest p-value, all candidates together
MUCH, OWN_CHANCE = 0.25, 0.01  # or so large a fall every way, with so large a p-value of the candidate alone
VALIDATION = 0.02  # by which a member may raise the mean square of a validation recording on its joints
MOST = 8  # members
_SHARES = (FALL, FALL, HALVES)  # of the views
_LISTED = 6
_STRUCTURE = 0.1  # of the error that a curve over a variable must predict on unseen motion to call it unexplained


def diagnose_by_prediction(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
) -> Diagnosis:
    """Return what is missing from a model by the error on data left out; the verdict is never `adequate`.

    One recording is left out at a time; a single one is cut into blocks of a second, into quarters and into halves, and
    an effect has to help each way. A named effect removes 10 % or more of the squared error, beyond chance, and doesn't
    harm the validation.
    """
    tell(0.05, "trying every effect")
    whole = weighed_by_residual(measurements, structure)
    stage = first = Foreseen.of(whole)
    members: list[Score] = []
    while len(members) < MOST:
        tell(after(len(members), 0.3, 0.8), "looking for more" if members else "looking for a cause")
        found = _choose(stage, members, whole, validation)
        if found is None:
            break
        members.append(found)
        stage = first.under(members)
    tell(0.8, "weighing what was found")
    members, against = possible(_needed(first, members), whole)
    return with_doubt(_conclude(whole, first, members, validation, against), whole)


def _choose(
    stage: Foreseen, members: Sequence[Score], whole: Evidence, validation: Sequence[Measurement]
) -> Score | None:
    """Return the best candidate that is worth a name, the simplest of those that tie with it; None where none is."""
    view = stage.views[0]
    for best in stage.scores:
        if best.held_out <= 0.0:
            return None
        if not _worthwhile(best, stage):
            continue
        rivals = tied(best, stage.scores, view.evidence, view.folds)
        equals = [best, *(rival for rival in rivals if _worthwhile(rival, stage))]
        for chosen in sorted(equals, key=lambda s: (s.effect.size, -s.held_out)):
            found = refined(chosen, view.evidence, view.folds)
            if not _harms(found, members, whole, validation):
                return found
    return None


def _worthwhile(candidate: Score, stage: Foreseen) -> bool:
    """Return whether a candidate's error falls clearly whichever way parts are left out, and beyond chance.

    Chance among all candidates, or, where it falls much every way, its own.
    """
    joints = list(candidate.columns.joints)
    least = _least(joints, stage.evidence.structure)
    if candidate.held_out_by_joint[joints].sum() < least * stage.views[0].loss[joints].sum():
        return False
    falls = [float(view.falls(candidate).sum() / view.loss[joints].sum()) for view in stage.views]
    if any(fall < share for fall, share in zip(falls, (least, least, HALVES), strict=False)):
        return False
    chance = stage.views[0].chance(candidate)
    return chance * len(stage.candidates) <= CHANCE or (min(falls) >= MUCH and chance <= OWN_CHANCE)


def _least(joints: Sequence[int], structure: Structure) -> float:
    """Return the share of the error that a further member at some joints must remove."""
    held = structure.added
    return AGAIN if any(effect.whole or effect.joint in joints for effect in held) else FALL


def _harms(found: Score, members: Sequence[Score], whole: Evidence, validation: Sequence[Measurement]) -> bool:
    """Return whether a validation recording is predicted worse with an effect than without."""
    if not validation:
        return False
    names = [whole.structure.robot.joints[joint] for joint in found.columns.joints]
    before = errors(extended(whole, [m.effect for m in members]), validation)
    after = errors(extended(whole, [*(m.effect for m in members), found.effect]), validation)
    return sum(after[name] for name in names) > (1.0 + VALIDATION) * sum(before[name] for name in names)


def _needed(first: Foreseen, members: list[Score]) -> list[Score]:
    """Return the members without which the held-out error rises clearly, given the others."""
    for member in list(members):
        others = [m for m in members if m is not member]
        joints = list(member.columns.joints)
        views = zip(first.views_under(members), first.views_under(others), _SHARES, strict=False)
        if any(
            lacking.loss[joints].sum() - having.loss[joints].sum() < share * lacking.loss[joints].sum()
            for having, lacking, share in views
        ):
            members = others
    return members


def _conclude(
    whole: Evidence,
    first: Foreseen,
    members: list[Score],
    validation: Sequence[Measurement],
    notes: Sequence[str],
) -> Diagnosis:
    final = extended(whole, [m.effect for m in members])
    labels = {m.label for m in members}
    missing = [_suspect(first, whole, m, [o for o in members if o is not m], validation) for m in members]
    others = [s for s in first.scores if s.label not in labels and first.views[0].share(s) > 0.5 * FALL]
    left = mean_squares(final)
    worst = _worst(final)
    rest = explain_by_variables(in_parts(final), worst, floor=False)
    structured = max(rest.depends_on.values(), default=0.0) >= _STRUCTURE
    verdict: Verdict = "missing" if members else "unexplained" if structured else "not_decidable"
    return Diagnosis(
        verdict=verdict,
        missing=tuple(missing),
        others=tuple(_suspect(first, whole, s, [], validation) for s in others[:_LISTED]),
        remaining_rms={name: float(np.sqrt(value)) for name, value in left.items()},
        unexplained=rest if structured else None,
        notes=tuple(notes),
    )


def _worst(evidence: Evidence) -> int:
    """Return the joint whose residual is the largest share of its torque."""
    share = np.zeros(evidence.structure.robot.n)
    power = np.sum([np.sum(t.y**2, axis=0) for t in evidence.trajectories], axis=0)
    for r in evidence.residual:
        share += np.sum(r**2, axis=0) / np.maximum(power, 1e-300)
    return int(np.argmax(share))


def _suspect(
    first: Foreseen, whole: Evidence, found: Score, fellows: Sequence[Score], validation: Sequence[Measurement]
) -> Suspect:
    """Return a candidate with what it does beside its fellow members, before and after."""
    before = extended(whole, [m.effect for m in fellows])
    after = extended(before, [found.effect])
    stage = first.under(fellows)
    mine = stage.score_of(found)
    view = stage.views[0]
    rivals = tied(mine, stage.scores, view.evidence, view.folds)
    return Suspect(
        effect=found.effect,
        p_value=stage.p_value(mine),
        explained=float(np.clip(view.share(mine), 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=errors(before, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found.effect),
        tied_with=tuple(rival.label for rival in rivals),
        experiment=experiment_between(found.effect, [rival.effect for rival in rivals], whole.structure.robot),
    )
