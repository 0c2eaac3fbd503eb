"""Evidence on a model with the members found so far, and which effect is to be the next member."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.candidates import Candidate, Folds, Score, enumerate_candidates, exactly, score
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.diagnosis.hidden_path import gain_beside_hidden_path
from robot_ident.diagnosis.lack_of_fit import LackOfFit, lack_of_fit
from robot_ident.diagnosis.refine import refined, sharpened
from robot_ident.diagnosis.scan import base_gram
from robot_ident.diagnosis.ties import tied
from robot_ident.diagnosis.unseen import Unseen
from robot_ident.effects import Effect
from robot_ident.signals.motion import Array

GAIN = 40.0  # chi-square units that a member must gain
PART = 0.35  # of the present excess on its joints that every member must explain, seen by trajectories left out
AGAIN = 0.5  # the same where a joint has a member already: what an imperfect column leaves looks like another effect
ALIKE = 0.75  # the same where that member is the same effect, of all joints or of the one
LATER = 0.08  # of the excess that there was at first, which a further member on a joint must explain, too
KEPT_ASIDE = 0.6  # of the excess on recordings that no fit sees, and of that on the fitted ones: enough by itself
OWN = 0.4  # of its gain that an effect must keep beside what the hidden part of the path may make
CERTAIN = 160.0  # the same in chi-square units: enough where the effect explains nearly all of its joints' excess
NEARLY_ALL = 0.8  # the same from which on the hidden part isn't in question, whether its joints lack fit or not
MOSTLY = 0.6  # of a joint's excess, explained where there is one recording only; or by a column, so no gap made it
_EXACT = 3  # candidates that are refined before recordings kept aside judge them
_STAGE = "stage"  # of the memory of an evidence
LEAST = 0.25  # Nm rms (times the torque scale of the joint over 400 Nm) that every member must remove


@dataclass(frozen=True)
class Stage:
    """Evidence on the model with the members found so far, and all that follows from it.

    first: that of the model as it was given, None where this is it.
    """

    evidence: Evidence
    fits: tuple[LackOfFit, ...]
    folds: Folds
    candidates: dict[str, Candidate]
    scores: list[Score]
    first: Stage | None = None

    @classmethod
    def of(cls, evidence: Evidence, unseen: Unseen | None = None, first: Stage | None = None) -> Stage:
        """Score every candidate; unseen: recordings that no fit sees."""
        base = base_gram(evidence)
        folds = Folds.of(base, None if unseen is None else unseen.under(evidence))
        candidates = {candidate.label: candidate for candidate in enumerate_candidates(evidence)}
        scores = [score(candidate, evidence, folds) for candidate in candidates.values()]
        scores.sort(key=lambda s: -s.held_out)
        return cls(evidence, lack_of_fit(evidence, base), folds, candidates, scores, first)

    def under(self, evidence: Evidence, effects: Sequence[Effect]) -> Stage:
        """Return the stage of the model of an evidence with further effects, the same recordings kept aside.

        Computed once: members are looked at in each other's light again and again.
        """
        key = (_STAGE, id(self.initial), evidence.structure.labels, tuple(exactly(effect) for effect in effects))
        if key not in evidence.memory:
            evidence.memory[key] = Stage.of(extended(evidence, effects), self.folds.unseen, self.initial)
        found = evidence.memory[key]
        assert isinstance(found, Stage)
        return found

    @property
    def initial(self) -> Stage:
        """The stage of the model as it was given."""
        return self.first or self

    @property
    def excess(self) -> Array:
        """Held-out squared error [n] beyond the noise, recordings that no fit sees included."""
        left_out = np.maximum(self.folds.loss.sum(axis=0) - self._dof, 0.0)
        return left_out if self.unseen_excess is None else np.asarray(left_out + self.unseen_excess)

    @property
    def surely(self) -> Array:
        """Excess [n] less a standard deviation of what noise makes of it, (2 dof)^(1/2): what there is to explain.

        The noise itself can't be explained; of a faint excess it is the larger part.
        """
        unseen = self.folds.unseen
        dof = self._dof if unseen is None else self._dof + unseen.dof
        return np.maximum(self.excess - np.sqrt(2.0 * dof), 0.0)

    @property
    def _dof(self) -> Array:
        return np.array([sum(t.dof[j] for t in self.evidence.trajectories) for j in range(len(self.fits))])

    @property
    def unseen_excess(self) -> Array | None:
        """Squared error [n] beyond the noise on recordings that no fit sees; None without any."""
        unseen = self.folds.unseen
        return None if unseen is None else np.maximum(unseen.loss(self.folds.whole) - unseen.dof, 0.0)

    @property
    def loss(self) -> Array:
        """Squared error [n] of all that is predicted, recordings that no fit sees included."""
        unseen, left_out = self.folds.unseen, self.folds.loss.sum(axis=0)
        return np.asarray(left_out if unseen is None else left_out + unseen.loss(self.folds.whole))

    @property
    def doubtful(self) -> bool:
        """Whether a joint lacks fit, or a single effect gains more than chance ever would."""
        return any(f.fails for f in self.fits) or any(s.gain >= GAIN and s.held_out >= GAIN / 2 for s in self.scores)


def choose(stage: Stage, rattling: Collection[int] = ()) -> Score | None:
    """Return the next member: the best on trajectories left out, the simplest of those that tie with it, refined.

    rattling: joints with a gap, where no brief effect is looked for.
    """
    listed = _foreseen(stage)
    for best in listed:
        if best.held_out <= 0.0:
            return None
        if not worthwhile(best, stage, rattling):
            continue
        scores = sharpened(best, listed, stage.evidence, stage.folds)
        leader = next((s for s in scores if worthwhile(s, stage, rattling)), None)
        if leader is None:  # it seemed so on a point of its grid only
            continue
        rivals = tied(leader, scores, stage.evidence, stage.folds)
        equals = [leader, *(r for r in rivals if worthwhile(r, stage, rattling))]
        simplest = min(equals, key=lambda s: (s.effect.size, -s.held_out))
        return refined(simplest, stage.evidence, stage.folds)
    return None


def _foreseen(stage: Stage) -> list[Score]:
    """Return the scores, best first; where recordings are kept aside, with those refined that gain most.

    What a single motion shows is foreseen on another by its exact place alone.
    """
    if stage.folds.unseen is None:
        return stage.scores
    most = sorted(stage.scores, key=lambda s: -s.gain)[:_EXACT]
    exact = {s.label: refined(s, stage.evidence, stage.folds) for s in most if s.gain >= GAIN}
    return sorted((exact.get(s.label, s) for s in stage.scores), key=lambda s: -s.held_out)


def worthwhile(candidate: Score, stage: Stage, rattling: Collection[int]) -> bool:
    """Return whether a candidate gains enough, explains enough of its joints' excess, and removes enough torque."""
    gains, held = candidate.held_out_by_joint, stage.evidence.structure.added
    joints = [
        j
        for j in candidate.columns.joints
        if not (candidate.effect.brief and j in rattling)
        and (stage.fits[j].fails or (gains[j] >= GAIN / 2 and not _touched(held, [j])))
        and j in candidate.mainly
    ]
    mine = candidate.effect.joint
    if candidate.gain < GAIN or not joints:
        return False
    if mine is not None and stage.fits[mine].fails and gains[mine] < 0.0:
        return False  # it makes its own joint, which lacks something, only worse
    if not (_explains(candidate, stage, joints) or _told(candidate, stage, joints)):
        return False
    weights = [np.mean([np.mean(t.weight[:, j] ** 2) for t in stage.evidence.trajectories]) for j in joints]
    rows = [sum(len(t.y) for t in stage.evidence.trajectories)] * len(joints)
    mean_square = sum(gains[j] / max(w * r, 1e-300) for j, w, r in zip(joints, weights, rows, strict=True))
    if np.sqrt(max(mean_square, 0.0)) < min(least_torque(stage.evidence, j) for j in joints):
        return False
    own = gain_beside_hidden_path(candidate, stage.evidence)
    if own < NEARLY_ALL * candidate.gain and not any(stage.fits[j].fails for j in joints):
        return False  # beside the hidden path these joints lack nothing
    if own >= CERTAIN and _removed(candidate, joints) >= NEARLY_ALL * stage.surely[joints].sum():
        return True
    return own >= max(GAIN, OWN * candidate.gain)


def _explains(candidate: Score, stage: Stage, joints: Sequence[int]) -> bool:
    """Return whether a candidate explains enough of some joints' excess on all that is predicted."""
    removed, held = _removed(candidate, joints), stage.evidence.structure.added
    if not _touched(held, joints):
        return bool(removed >= PART * stage.surely[joints].sum())
    share = ALIKE if any(effect.name == candidate.effect.name for effect in held) else AGAIN
    return bool(removed >= max(share * stage.excess[joints].sum(), LATER * stage.initial.excess[joints].sum()))


def _removed(candidate: Score, joints: Sequence[int]) -> float:
    return float(candidate.held_out_by_joint[joints].sum())


def _told(candidate: Score, stage: Stage, joints: Sequence[int]) -> bool:
    """Return whether recordings that no fit sees tell of a candidate by themselves.

    What a single motion shows can't be predicted from the others, however much of it is explained.
    """
    if candidate.unseen_by_joint is None or stage.unseen_excess is None:
        return False
    excess, removed = stage.unseen_excess[joints].sum(), candidate.unseen_by_joint[joints].sum()
    fitted = sum(
        float(np.sum(r[:, joints] ** 2)) - float(t.dof[joints].sum())
        for t, r in zip(stage.evidence.trajectories, stage.evidence.residual, strict=True)
    )
    least = max(GAIN, KEPT_ASIDE * excess)
    if _touched(stage.evidence.structure.added, joints) and stage.initial.unseen_excess is not None:
        least = max(least, LATER * stage.initial.unseen_excess[joints].sum())
    return bool(removed >= least and candidate.gain >= KEPT_ASIDE * fitted)


def least_torque(evidence: Evidence, joint: int) -> float:
    """Return the torque [Nm rms] that something on a joint must make to be worth a name.

    In A, where a drive's gain is unknown, the limit isn't: twice what the motions need stands for it.
    """
    robot = evidence.structure.robot
    if robot.in_ampere(joint):
        peak = max(float(np.abs(t.measured.torque[:, joint]).max()) for t in evidence.trajectories)
        return LEAST * 2.0 * peak / 400.0
    limit = float(robot.limits.torque[joint])
    return LEAST * (limit if np.isfinite(limit) else 400.0) / 400.0


def much_is_left(stage: Stage, joint: int) -> bool:
    """Return whether a joint lacks fit by more than an imperfect formula of a member leaves, and no column explains
    most of that.
    """
    fit, initial = stage.fits[joint], stage.initial.excess
    large = np.sqrt(fit.excess) >= least_torque(stage.evidence, joint)
    best = max((s.held_out_by_joint[joint] for s in stage.scores), default=0.0)
    return bool(
        fit.fails and large and stage.excess[joint] >= LATER * initial[joint] and best < MOSTLY * stage.excess[joint]
    )


def _touched(effects: Sequence[Effect], joints: Collection[int]) -> bool:
    """Return whether an effect is at one of some joints, or everywhere."""
    return any(effect.joint in joints or effect.place is None for effect in effects)


def reconsider(
    evidence: Evidence, members: list[Score], stage: Stage, rattling: Collection[int], places: Sequence[int]
) -> tuple[list[Score], Stage]:
    """Choose the members at some places again, given the others; drop one that explains nothing any more."""
    for place in places:
        others = [m for k, m in enumerate(members) if k != place]
        without = stage.under(evidence, [m.effect for m in others])
        again = choose(without, rattling)
        if again is None:
            return others, without
        if again.label != members[place].label:
            changed = [*members[:place], again, *members[place + 1 :]]
            if len({m.label for m in changed}) == len(changed):
                fresh = stage.under(evidence, [m.effect for m in changed])
                if fresh.loss.sum() < stage.loss.sum() - GAIN / 4:
                    members, stage = changed, fresh
    return members, stage
