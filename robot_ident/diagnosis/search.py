"""The search for what is missing: effects and gaps, one after the other, each on what the earlier ones leave."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import numpy as np

from robot_ident.diagnosis.backlash import best_gap, gap_behind, gap_near, muted
from robot_ident.diagnosis.candidates import Score
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.progress import Tell, after
from robot_ident.diagnosis.stage import GAIN, MOSTLY, PART, Stage, choose, least_torque, much_is_left, reconsider
from robot_ident.effects import Effect

MOST = 6  # members
_LEAD, _Z = 0.05, 2.0  # of a gap's gain, and standard deviations of a difference of gains, that are no lead


class Search:
    """Looks for members one after the other; where a gap makes joints rattle, in the time between its bursts.

    given: stage of the model as it was given; first: the same in the time in which nothing rattles; last: with the
    members. rattling: by joint, the joints whose gaps make it rattle; gaps: those found, by joint, the plainest first.
    """

    def __init__(self, evidence: Evidence, given: Stage) -> None:
        """Begin with the model as it was given."""
        self.evidence = evidence
        self.given = self.first = self.last = given
        self.members: list[Score] = []
        self.rattling: dict[int, set[int]] = {}
        self.gaps: dict[int, Effect] = {}

    def run(self, tell: Tell) -> Search:
        """Add members until nothing more explains enough."""
        steps = count()
        while True:
            names = ", ".join(member.label for member in self.members)
            tell(after(next(steps), 0.4, 0.8), f"looking for more than {names}" if names else "looking for a cause")
            if len(self.members) < MOST and self.last.doubtful and (self._rattles() or self._adds()):
                continue
            if not self._crosses():
                return self

    def _adds(self) -> bool:
        """Return whether one more effect was found."""
        found = choose(self.last, self.rattling)
        if found is None:
            return False
        self.members.append(found)
        self._again()
        self._reconsider(range(len(self.members) - 1))
        return True

    def _rattles(self) -> bool:
        """Return whether bursts tell of a gap not known yet; what comes is then judged without their time."""
        joints = range(len(self.last.fits))
        loud = [j for j in joints if j not in self.gaps and much_is_left(self.last, j)]
        if not self.gaps:
            gap = gap_behind(self.last.evidence, self.last.folds, loud, joints)
        else:  # what is left of a gap's own bursts is no second one
            gap = gap_behind(self.last.evidence, self.last.folds, loud, self._without_gap)
            gap = gap if gap is not None and self._explained(gap, PART) else None
        if gap is None:
            return False
        self._keep(gap, loud)
        return True

    def _crosses(self) -> bool:
        """Return whether a gap is there that explains most of what a joint lacks, clearly more than any effect does.

        Blows that noise hides by themselves are seen by a column that says where each of them is.
        """
        gap = best_gap(self.last.evidence, self.last.folds, self._without_gap)
        if gap is None or not self._explained(gap, MOSTLY):
            return False
        rivals = [s.held_out for s in self.last.scores if gap.effect.joint in s.columns.joints]
        if gap.held_out - max(rivals, default=0.0) < max(_LEAD * gap.held_out, _Z * float(np.sqrt(gap.held_out))):
            return False
        self._keep(gap, ())
        return True

    @property
    def _without_gap(self) -> list[int]:
        return [j for j in range(len(self.last.fits)) if j not in self.gaps]

    def _explained(self, gap: Score, share: float) -> bool:
        """Return whether a gap explains a share of what its joints lack, and enough torque to be worth a name.

        Its blows shake other joints, too.
        """
        evidence, gains = self.last.evidence, gap.held_out_by_joint
        power = np.sum([np.sum(t.weight**2, axis=0) for t in evidence.trajectories], axis=0)
        joints = gap.mainly
        enough = any(gains[j] >= power[j] * least_torque(evidence, j) ** 2 for j in joints)
        return enough and float(gains[joints].sum()) >= share * float(self.last.surely[joints].sum())

    def _keep(self, gap: Score, loud: Sequence[int]) -> None:
        """Judge what comes without the time in which a gap makes its own joint and others rattle: loud ones and those
        that it shakes. Members are judged again: they may have followed its bursts.
        """
        self.gaps[gap.effect.joint] = gap.effect
        for joint in {*loud, *self._shaken(gap.effect), gap.effect.joint}:
            self.rattling.setdefault(joint, set()).add(gap.effect.joint)
        self.evidence, unseen = muted(self.evidence, self.first.folds.unseen, self.rattling)
        self.first = Stage.of(self.evidence, unseen)
        self._again()
        self._reconsider(range(len(self.members)))

    def _shaken(self, gap: Effect) -> list[int]:
        """Return the joints of whose excess, without any member, a gap explains most."""
        alone = gap_near(gap, self.first.evidence, self.first.folds)
        if alone is None:
            return []
        return np.flatnonzero(alone.held_out_by_joint >= MOSTLY * np.maximum(self.first.surely, GAIN)).tolist()

    def _reconsider(self, places: Sequence[int]) -> None:
        self.members, self.last = reconsider(self.evidence, self.members, self.last, self.rattling, places)

    def _again(self) -> None:
        self.last = self.first.under(self.evidence, [m.effect for m in self.members])
