"""Suspects with all that is known of them: alone among their fellow members, before and after they are added."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.design.discrimination import experiment_between
from robot_ident.diagnosis.backlash import gap_near
from robot_ident.diagnosis.before_after import errors, estimates, mean_squares
from robot_ident.diagnosis.candidates import Folds, Score
from robot_ident.diagnosis.diagnosis import Suspect
from robot_ident.diagnosis.evidence import Evidence, extended
from robot_ident.diagnosis.refine import sharpened
from robot_ident.diagnosis.scan import base_gram
from robot_ident.diagnosis.stage import GAIN, Stage
from robot_ident.diagnosis.ties import tied
from robot_ident.effects import Effect
from robot_ident.recording.measurement import Measurement

_LISTED = 6  # candidates reported beside the members


@dataclass(frozen=True)
class Ground:
    """What suspects are judged on.

    whole: evidence on the model as it was given; first: its stage, without the time in which joints rattle; gaps: what
    makes them. validation: recordings whose error before and after is told.
    """

    whole: Evidence
    first: Stage
    gaps: tuple[Effect, ...]
    validation: Sequence[Measurement]

    def errors(self, evidence: Evidence) -> dict[str, float] | None:
        """Return the mean square error of the validation by joint, (Nm)^2; None without one."""
        return errors(evidence, self.validation) if self.validation else None


def suspect(ground: Ground, found: Score, members: Sequence[Score] = ()) -> Suspect:
    """Return a candidate, or a member among its fellows, with what adding it does."""
    from scipy.special import chdtrc

    fellows = [m.effect for m in members if m.label != found.label]
    stage = ground.first.under(ground.first.evidence, fellows) if fellows else ground.first
    mine = next((s for s in stage.scores if s.label == found.label), None)
    rivals: list[Score] = []
    if mine is not None:
        scores = sharpened(mine, stage.scores, stage.evidence, stage.folds) if members else stage.scores
        mine = next(s for s in scores if s.label == found.label)
        rivals = tied(mine, scores, stage.evidence, stage.folds)
    mine = mine or found
    beside = [*fellows, *(ground.gaps if members else ())]
    before = extended(ground.whole, beside) if beside else ground.whole
    after = extended(before, [found.effect])
    joints = list(mine.columns.joints)
    excess = max(float(stage.excess[joints].sum()), 1e-300)
    dof = found.effect.size
    return Suspect(
        effect=found.effect,
        p_value=min(1.0, float(chdtrc(dof, max(mine.gain, 0.0))) * len(stage.candidates)),
        explained=float(np.clip(mine.held_out_by_joint[joints].sum() / excess, 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=ground.errors(before),
        validation_after=ground.errors(after),
        parameters=estimates(after, found.effect),
        tied_with=tuple(r.label for r in rivals),
        experiment=experiment_between(found.effect, [r.effect for r in rivals], ground.whole.structure.robot),
    )


def further(ground: Ground, named: Collection[str], failing: Collection[int]) -> list[Suspect]:
    """Return the best of the other candidates for failing joints, on the model as it was."""
    best = [s for s in ground.first.scores if s.label not in named and s.held_out > 0.0 and s.gain >= GAIN]
    best = [s for s in best if set(s.columns.joints) & set(failing)]
    return [suspect(ground, s) for s in best[:_LISTED]]


def gap_suspects(
    whole: Evidence, members: Sequence[Score], gaps: Sequence[Effect], validation: Sequence[Measurement]
) -> list[Suspect]:
    """Return those of some gaps, the plainest first, whose column gains enough beside the members and the other gaps.

    Blows of two gaps overlap in time: each is fitted again in the light of the others.
    """
    kept: list[Score] = []
    effects = [m.effect for m in members]
    for gap in gaps:
        found = _beside(gap, whole, [*effects, *(other.effect for other in kept)])
        kept += [] if found is None else [found]
    for place in range(len(kept) - 1):
        others = [other.effect for k, other in enumerate(kept) if k != place]
        kept[place] = _beside(kept[place].effect, whole, [*effects, *others]) or kept[place]
    return [_gap_suspect(one, whole, [*effects, *(k.effect for k in kept if k is not one)], validation) for one in kept]


def _beside(gap: Effect, whole: Evidence, fellows: Sequence[Effect]) -> Score | None:
    before = extended(whole, fellows) if fellows else whole
    return gap_near(gap, before, Folds.of(base_gram(before)))


def _gap_suspect(
    found: Score, whole: Evidence, fellows: Sequence[Effect], validation: Sequence[Measurement]
) -> Suspect:
    from scipy.special import chdtrc

    before = extended(whole, fellows) if fellows else whole
    after = extended(before, [found.effect])
    joints, loss = list(found.columns.joints), Folds.of(base_gram(before)).loss
    excess = float(loss[:, joints].sum()) - sum(float(t.dof[joints].sum()) for t in before.trajectories)
    return Suspect(
        effect=found.effect,
        p_value=min(1.0, float(chdtrc(1 + len(found.effect.inner), found.gain)) * whole.structure.robot.n),
        explained=float(np.clip(found.held_out_by_joint[joints].sum() / max(excess, 1e-300), 0.0, 1.0)),
        mse_before=mean_squares(before),
        mse_after=mean_squares(after),
        validation_before=errors(before, validation) if validation else None,
        validation_after=errors(after, validation) if validation else None,
        parameters=estimates(after, found.effect),
        tied_with=(),
        experiment=None,
    )
