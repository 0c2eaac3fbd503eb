"""Which physical effect is missing: found by what predicts a motion that it has not seen.

Once a model misfits, almost every column is significant, so significance decides only whether something is missing.
What is missing is decided by held-out prediction: the true cause keeps its coefficient on another trajectory, a
proxy's changes. Effects are added one by one, each chosen on what the earlier ones leave, and the earlier ones are
chosen again in its light.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.amount import too_little, unseen_below
from robot_ident.diagnosis.backlash import burst_cause
from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.by_prediction import diagnose_by_prediction, tells_noise
from robot_ident.diagnosis.candidates import Candidate, Folds, Score, candidate_of, enumerate_candidates, score
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect, Verdict
from robot_ident.diagnosis.drift import drift_gain
from robot_ident.diagnosis.evidence import Evidence, added, extended, gather, split
from robot_ident.diagnosis.hidden_path import gain_beside_hidden_path
from robot_ident.diagnosis.lack_of_fit import LackOfFit, joint_noise, lack_of_fit
from robot_ident.diagnosis.refine import refined, sharpened
from robot_ident.diagnosis.scan import base_gram
from robot_ident.diagnosis.ties import tied
from robot_ident.diagnosis.unexplained import explain_by_variables
from robot_ident.effects import Effect, make_effect
from robot_ident.excitation.tell import experiment_between
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement

GAIN = 40.0  # chi-square units that a member must gain
SHARE = 0.35  # of a joint's excess that its members must explain on trajectories not seen
STRICTER = 0.45  # more than that where what remains is far above the noise: a proxy leaves much, a cause little
PART = 0.35  # of the present excess on its joints that every member must explain, seen by trajectories left out
AGAIN = 0.5  # the same where a joint has a member already: what an imperfect column leaves looks like another effect
LATER = 0.08  # of the excess that there was at first, which a further member on a joint must explain, too
OWN = 0.5  # of its gain that an effect must keep beside what the hidden part of the path may make
ALONE = 0.4  # of its held-out gain that any other effect may reach there
MOSTLY = 0.6  # of a joint's excess, explained where there is one recording only; or by a column, so no gap made it
LEAST = 0.25  # Nm rms (times the torque scale of the joint over 400 Nm) that every member must remove
MOST = 6  # members
_LISTED = 6  # candidates reported beside the members


@dataclass(frozen=True)
class _Stage:
    """Evidence on the model with the members found so far, and all that follows from it.

    initial [n]: excess of the model as it was given, None where this is it.
    """

    evidence: Evidence
    fits: tuple[LackOfFit, ...]
    folds: Folds
    candidates: dict[str, Candidate]
    scores: list[Score]
    initial: Array | None = None

    @property
    def excess(self) -> Array:
        """Held-out squared error [n] beyond the noise."""
        dof = np.array([sum(t.dof[j] for t in self.evidence.trajectories) for j in range(len(self.fits))])
        return np.maximum(self.folds.loss.sum(axis=0) - dof, 0.0)


def diagnose(
    measurements: Sequence[Measurement], structure: Structure, validation: Sequence[Measurement] = ()
) -> Diagnosis:
    """Return what is missing from a model, judged on several periodic recordings.

    validation: measurements that never enter a fit; their error before and after each candidate is evidence. Where a
    recording doesn't tell its noise, all are judged by prediction alone, and none can be called adequate.
    """
    if not all(tells_noise(measured) for measured in measurements):
        return diagnose_by_prediction(measurements, structure, validation)
    notes: list[str] = []
    evidence = gather(measurements, structure)
    if len(evidence.trajectories) < 2:
        evidence = split(evidence)
        notes.append(
            "one trajectory only: judged by parts of its own motion, which tells causes from proxies less well;"
            " record another motion"
        )
    first = _stage(evidence)
    stage = first
    members: list[Score] = []
    rattling: dict[int, int] = {}
    while len(members) < MOST and _doubtful(stage):
        for joint in (j for j in range(len(stage.fits)) if _much_is_left(stage, j)):
            cause = burst_cause(stage.evidence, joint)
            if cause is not None:
                rattling[joint] = cause
        found = _choose(stage, rattling)
        if found is None:
            break
        members.append(found)
        stage = _stage(extended(evidence, [m.effect for m in members]), first.excess)
        members, stage = _reconsider(evidence, members, stage, rattling)
    return _conclude(evidence, first, stage, members, rattling, validation, notes)


def _doubtful(stage: _Stage) -> bool:
    """Return whether a joint lacks fit, or a single effect gains more than chance ever would."""
    return any(fit.fails for fit in stage.fits) or any(s.gain >= GAIN and s.held_out >= GAIN / 2 for s in stage.scores)


def _stage(evidence: Evidence, initial: Array | None = None) -> _Stage:
    base = base_gram(evidence)
    folds = Folds.of(base)
    candidates = {candidate.label: candidate for candidate in enumerate_candidates(evidence)}
    scores = [score(candidate, evidence, folds) for candidate in candidates.values()]
    scores.sort(key=lambda s: -s.held_out)
    return _Stage(evidence, lack_of_fit(evidence, base), folds, candidates, scores, initial)


def _choose(stage: _Stage, known: Collection[int]) -> Score | None:
    """Return the next member: the best on trajectories left out, the simplest of those that tie with it, refined.

    known: joints whose error is explained already by an effect without columns.
    """
    for best in stage.scores:
        if best.held_out <= 0.0:
            return None
        if not _worthwhile(best, stage, known):
            continue
        scores = sharpened(best, stage.scores, stage.evidence, stage.folds)
        leader = next((s for s in scores if _worthwhile(s, stage, known)), best)
        rivals = tied(leader, scores, stage.evidence, stage.folds)
        equals = [leader, *(r for r in rivals if _worthwhile(r, stage, known))]
        simplest = min(equals, key=lambda s: (_size(s.effect), -s.held_out))
        return refined(simplest, stage.evidence, stage.folds)
    return None


def _size(effect: Effect) -> int:
    """Return the number of an effect's parameters, inner ones included."""
    return len(effect.coefficients) + len(effect.inner)


def _worthwhile(candidate: Score, stage: _Stage, known: Collection[int]) -> bool:
    """Return whether a candidate gains enough, explains enough of its joints' excess, and removes enough torque."""
    gains, held = candidate.held_out_by_joint, added(stage.evidence.structure)
    joints = [
        j
        for j in candidate.columns.joints
        if j not in known and (stage.fits[j].fails or (gains[j] >= GAIN / 2 and not _touched(held, [j])))
    ]
    if candidate.gain < GAIN or not joints:
        return False
    excess, removed = stage.excess[joints].sum(), candidate.held_out_by_joint[joints].sum()
    if _touched(held, joints):
        initial = excess if stage.initial is None else stage.initial[joints].sum()
        if removed < max(AGAIN * excess, LATER * initial):
            return False
    elif removed < PART * excess:
        return False
    weights = [np.mean([np.mean(t.weight[:, j] ** 2) for t in stage.evidence.trajectories]) for j in joints]
    rows = [sum(len(t.y) for t in stage.evidence.trajectories)] * len(joints)
    mean_square = sum(
        candidate.held_out_by_joint[j] / max(w * r, 1e-300) for j, w, r in zip(joints, weights, rows, strict=True)
    )
    if np.sqrt(max(mean_square, 0.0)) < min(_least(stage, j) for j in joints):
        return False
    return gain_beside_hidden_path(candidate, stage.evidence) >= max(GAIN, OWN * candidate.gain)


def _least(stage: _Stage, joint: int) -> float:
    """Return the torque [Nm rms] that something on a joint must make to be worth a name."""
    limit = float(stage.evidence.structure.robot.limits.torque[joint])
    return LEAST * (limit if np.isfinite(limit) else 400.0) / 400.0


def _much_is_left(stage: _Stage, joint: int) -> bool:
    """Return whether a joint lacks fit by more than an imperfect formula of a member leaves, and no column explains
    most of that.
    """
    fit, initial = stage.fits[joint], stage.excess if stage.initial is None else stage.initial
    large = np.sqrt(fit.excess) >= _least(stage, joint)
    best = max((s.held_out_by_joint[joint] for s in stage.scores), default=0.0)
    return bool(
        fit.fails and large and stage.excess[joint] >= LATER * initial[joint] and best < MOSTLY * stage.excess[joint]
    )


def _touched(effects: Sequence[Effect], joints: Collection[int]) -> bool:
    """Return whether an effect is at one of some joints, or everywhere."""
    return any(effect.joint in joints or effect.place is None for effect in effects)


def _reconsider(
    evidence: Evidence, members: list[Score], stage: _Stage, known: Collection[int]
) -> tuple[list[Score], _Stage]:
    """Choose every earlier member again, given the others; drop one that explains nothing any more."""
    for place in range(len(members) - 1):
        others = [m for k, m in enumerate(members) if k != place]
        without = _stage(extended(evidence, [m.effect for m in others]), stage.initial)
        again = _choose(without, known)
        if again is None:
            return others, without
        if again.label != members[place].label:
            changed = [*members[:place], again, *members[place + 1 :]]
            if len({m.label for m in changed}) == len(changed):
                fresh = _stage(extended(evidence, [m.effect for m in changed]), stage.initial)
                if fresh.folds.loss.sum() < stage.folds.loss.sum() - GAIN / 4:
                    members, stage = changed, fresh
    return members, stage


def _conclude(
    evidence: Evidence,
    first: _Stage,
    last: _Stage,
    members: list[Score],
    rattling: Mapping[int, int],
    validation: Sequence[Measurement],
    notes: list[str],
) -> Diagnosis:
    """Weigh what was found against what remains, and put it into words and figures."""
    robot = evidence.structure.robot
    failing = [j for j, fit in enumerate(first.fits) if fit.fails]
    failing += [j for m in members for j in m.columns.joints if j not in failing and m.held_out_by_joint[j] >= GAIN / 2]
    drifting = [j for j, gain in enumerate(drift_gain(evidence)) if gain >= GAIN]
    share = 1.0 - last.excess / np.maximum(first.excess, 1e-300)
    left = np.array([fit.excess for fit in last.fits])
    needed = SHARE + STRICTER * left / (left + joint_noise(evidence))
    trusted = [m for m in members if _trusted(m, share - needed, failing) or _stands_out(m, first, share)]
    if len(trusted) < len(members):
        last = _stage(extended(evidence, [m.effect for m in trusted])) if trusted else first
    rattles = {j: burst_cause(last.evidence, j) for j in rattling if last.fits[j].fails}
    gaps = sorted({cause for j, cause in rattles.items() if cause is not None and cause == rattling[j]})
    rest = [fit.excess for fit in last.fits]
    remaining = {name: float(np.sqrt(rest[j])) for j, name in enumerate(robot.joints)}
    verdict: Verdict = "adequate" if not failing else "missing" if trusted or gaps else "unexplained"
    if drifting:
        verdict = "missing"
    if verdict == "unexplained":
        more = too_little(first.scores, evidence, failing)
        verdict, notes = ("not_decidable", [*notes, more]) if more else (verdict, notes)
    elif verdict == "adequate":
        notes = [*notes, unseen_below(evidence)]
    suspects = [_suspect(evidence, first, m, trusted, validation) for m in trusted]
    suspects += [_recognised(last, "backlash", j) for j in gaps]
    suspects += [_recognised(last, "temperature_drift", j) for j in drifting]
    notes = [*notes, *_not_to_be_added(evidence, suspects)]
    further = _further(evidence, first, last, [m.label for m in trusted], failing, validation)
    open_joints = [j for j, fit in enumerate(last.fits) if fit.fails and j not in rattling]
    worst = max(open_joints, key=lambda j: last.fits[j].statistic, default=None)
    unexplained = None if worst is None else explain_by_variables(last.evidence, worst)
    return Diagnosis(verdict, tuple(suspects), tuple(further), remaining, unexplained, tuple(notes))


def _not_to_be_added(evidence: Evidence, suspects: Sequence[Suspect]) -> list[str]:
    """Return which of the suspects no model of these motions can hold, why, and what to do."""
    motions = [t.motion for t in evidence.trajectories]
    reasons = {s.label: [s.effect.hidden_in(motion) for motion in motions] for s in suspects}
    return [f"{label} can't be added: {why[0]}" for label, why in reasons.items() if all(why)]


def _trusted(member: Score, surplus: Array, failing: list[int]) -> bool:
    """Return whether all members together explain more than needed of the excess on one of a member's joints."""
    joints = [j for j in member.columns.joints if j in failing]
    return bool(joints) and float(np.max(surplus[joints])) >= 0.0


def _stands_out(member: Score, first: _Stage, share: Array) -> bool:
    """Return whether, of one recording alone, an effect explains most of the excess and no other comes near it.

    Parts left out of one motion are extrapolated to, so that even a cause doesn't explain them whole.
    """
    if len({id(t.measured) for t in first.evidence.trajectories}) > 1:
        return False
    joints = list(member.columns.joints)
    mine = next((s.held_out for s in first.scores if s.label == member.label), 0.0)
    rivals = [s.held_out for s in first.scores if s.label != member.label and set(s.columns.joints) & set(joints)]
    return float(np.max(share[joints])) >= MOSTLY and max(rivals, default=0.0) <= ALONE * mine


def _recognised(stage: _Stage, name: str, joint: int) -> Suspect:
    """Return an effect that is recognised by a test of its own: backlash by its bursts, drift by the trend of the
    periods.
    """
    evidence = stage.evidence
    effect = make_effect(f"{name}@{evidence.structure.robot.joints[joint]}", evidence.structure.robot)
    candidate = candidate_of(effect, evidence)
    if name == "backlash" and candidate.columns:
        effect = refined(score(candidate, evidence, stage.folds), evidence, stage.folds).effect
    after = extended(evidence, [effect]) if name == "backlash" else evidence
    return Suspect(
        effect=effect,
        p_value=stage.fits[joint].p_value if name == "backlash" else 0.0,
        explained=1.0,
        mse_before=mean_squares(evidence),
        mse_after=mean_squares(after),
        validation_before=None,
        validation_after=None,
        parameters=estimates(after, effect) if name == "backlash" else (),
        tied_with=(),
        experiment=None,
    )


def _further(
    evidence: Evidence,
    first: _Stage,
    last: _Stage,
    named: list[str],
    failing: list[int],
    validation: Sequence[Measurement],
) -> list[Suspect]:
    """Return the best of the other candidates, on the model as it was."""
    if not failing:
        return []
    best = [s for s in first.scores if s.label not in named and s.held_out > 0.0 and s.gain >= GAIN]
    best = [s for s in best if set(s.columns.joints) & set(failing)]
    return [_suspect(evidence, first, s, [], validation) for s in best[:_LISTED]]


def _suspect(
    evidence: Evidence, first: _Stage, found: Score, members: Sequence[Score], validation: Sequence[Measurement]
) -> Suspect:
    """Return a candidate with all that is known of it: alone among its fellow members, before and after."""
    from scipy.stats import chi2

    fellows = [m for m in members if m.label != found.label]
    before = extended(evidence, [m.effect for m in fellows]) if fellows else evidence
    stage = _stage(before) if fellows else first
    mine = next((s for s in stage.scores if s.label == found.label), None)
    rivals: list[Score] = []
    if mine is not None:
        scores = sharpened(mine, stage.scores, stage.evidence, stage.folds) if members else stage.scores
        mine = next(s for s in scores if s.label == found.label)
        rivals = tied(mine, scores, stage.evidence, stage.folds)
    mine = mine or found
    after = extended(before, [found.effect])
    joints = list(mine.columns.joints)
    excess = float(stage.excess[joints].sum())
    dof = len(found.effect.coefficients) + len(found.effect.inner)
    labels = tuple(r.label for r in rivals)
    return Suspect(
        effect=found.effect,
        p_value=min(1.0, float(chi2.sf(max(mine.gain, 0.0), dof)) * len(stage.candidates)),
        explained=float(np.clip(mine.held_out_by_joint[joints].sum() / excess, 0.0, 1.0)) if excess > 0 else 0.0,
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=errors(before, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found.effect),
        tied_with=labels,
        experiment=experiment_between(found.effect, [r.effect for r in rivals], evidence.structure.robot),
    )
