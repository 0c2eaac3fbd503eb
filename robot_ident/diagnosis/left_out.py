"""Evidence cut into parts, each of which is left out in turn, and how every candidate predicts them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.candidates import Candidate, Folds, Score, enumerate_candidates, score
from robot_ident.diagnosis.evidence import Evidence, extended, split
from robot_ident.diagnosis.scan import add, base_gram, columns_of, gram
from robot_ident.diagnosis.ties import BLOCK
from robot_ident.signals.motion import Array

_PARTS = 4
_BRIEF = 1.0  # s: of blocks that are left out in turn


def in_parts(whole: Evidence) -> Evidence:
    """Return an evidence of several parts: its recordings, or blocks of a second of the only one."""
    return whole if len(whole.trajectories) > 1 else split(whole, _PARTS, _BRIEF)


@dataclass(frozen=True)
class View:
    """Evidence cut one way, with the base fitted to all but each part."""

    evidence: Evidence
    folds: Folds

    @classmethod
    def of(cls, evidence: Evidence) -> View:
        """Fit the base to all but each part."""
        return cls(evidence, Folds.of(base_gram(evidence)))

    @property
    def loss(self) -> Array:
        """Held-out squared error [n]."""
        return np.asarray(self.folds.loss.sum(axis=0))

    def share(self, candidate: Score) -> float:
        """Return the share of the held-out squared error on its joints that a candidate removes."""
        joints = list(candidate.columns.joints)
        return float(candidate.held_out_by_joint[joints].sum() / max(self.loss[joints].sum(), 1e-300))

    def falls(self, candidate: Score) -> Array:
        """Return the fall of the held-out squared error in blocks of half a second, at a candidate's setting."""
        evidence, joints = self.evidence, list(candidate.columns.joints)
        columns = columns_of(candidate.effect, evidence, evidence.torques)
        inner = gram(columns, evidence)
        falls: list[float] = []
        for left, fit in enumerate(self.folds.without):
            t, phi = evidence.trajectories[left], evidence.phi[left][:, joints]
            addition = add(inner, fit, candidate.effect.ranges)
            before = t.y[:, joints] - phi @ fit.values
            after = t.y[:, joints] - phi @ addition.values - columns.parts[left] @ addition.coefficients
            seen = t.weight[:, joints].any(axis=1)
            fall = np.sum(before**2 - after**2, axis=1)[seen]
            size = max(1.0, BLOCK / (t.measured.dt * t.measured.decimate))
            falls += [float(block.sum()) for block in np.array_split(fall, max(1, round(len(fall) / size)))]
        return np.array(falls)

    def chance(self, candidate: Score) -> float:
        """Return the chance that a candidate's error falls so by accident, in blocks of half a second."""
        from scipy.special import stdtr

        falls = self.falls(candidate)
        spread = float(np.std(falls, ddof=1)) if len(falls) > 1 else 0.0
        if spread <= 0.0:
            return 1.0
        z = float(falls.mean()) / spread * np.sqrt(len(falls))
        return float(stdtr(len(falls) - 1, -z))


@dataclass(frozen=True)
class Foreseen:
    """A model seen by parts left out in every way, and the scores of the candidates in the first, best first."""

    views: tuple[View, ...]
    candidates: dict[str, Candidate]
    scores: list[Score]

    @classmethod
    def of(cls, whole: Evidence) -> Foreseen:
        """Leave out one recording at a time; of a single one blocks of a second, quarters and halves."""
        first = View.of(in_parts(whole))
        if len(whole.trajectories) > 1:
            return cls._scored((first,))
        return cls._scored((first, View.of(split(whole, _PARTS)), View.of(split(whole, 2))))

    @classmethod
    def _scored(cls, views: tuple[View, ...]) -> Foreseen:
        first = views[0]
        candidates = {candidate.label: candidate for candidate in enumerate_candidates(first.evidence)}
        scores = [score(candidate, first.evidence, first.folds) for candidate in candidates.values()]
        return cls(views, candidates, sorted(scores, key=lambda s: -s.held_out))

    def under(self, members: Sequence[Score]) -> Foreseen:
        """Return the same of the model with some members."""
        return self._scored(self.views_under(members)) if members else self

    def views_under(self, members: Sequence[Score]) -> tuple[View, ...]:
        """Return the views of the model with some members."""
        return tuple(View.of(extended(view.evidence, [m.effect for m in members])) for view in self.views)

    @property
    def evidence(self) -> Evidence:
        """The evidence in the parts of the first view."""
        return self.views[0].evidence

    def score_of(self, found: Score) -> Score:
        """Return the score of an effect in this model; as it was where it is no candidate any more."""
        return next((s for s in self.scores if s.label == found.label), found)

    def p_value(self, candidate: Score) -> float:
        """Return the chance that the error of any candidate falls so by accident (Bonferroni)."""
        return min(1.0, self.views[0].chance(candidate) * len(self.candidates))
