"""Which set of effects is missing, and where the cause is unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from robot_ident.diagnosis.diagnosis import Tell, silent
from robot_ident.diagnosis.selection.chance import Chance
from robot_ident.diagnosis.selection.consistency import splits
from robot_ident.diagnosis.selection.constants import (
    CHANCE,
    COMPLETE_SIZE_ERROR,
    FLEXIBLE_ERRORS,
    FLEXIBLE_SHARE,
    REMAINDER,
    STANDARD_ERRORS,
    VAGUE,
)
from robot_ident.diagnosis.selection.data_set import DataSet, Rows
from robot_ident.diagnosis.selection.fitted_set import FittedSet, standard_errors
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.probability import Election, elect
from robot_ident.diagnosis.selection.read_off import add_backlash, add_ripples
from robot_ident.diagnosis.selection.search import Search, Selected
from robot_ident.diagnosis.selection.unknown_cause import curve_of, flexible_beside, friction_of, groups_of
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import base_gram
from robot_ident.regression.misfit import LackOfFit, lack_of_fit


@dataclass(frozen=True)
class Withheld:
    """An effect that was selected and is not named, and why."""

    label: str
    why: str


@dataclass(frozen=True)
class Selection:
    """What was selected of a data set.

    selected: the set; vague: what would be in it, were its size known better or the motion's lines more. election:
    with its alternatives and their shares. chances: by label, that noise explains as much. fits: lack of fit of the
    model as it was. tested: the recordings in units of their noise.
    """

    selected: Selected
    vague: Selected
    election: Election | None
    chances: Mapping[str, float]
    fits: tuple[LackOfFit, ...]
    withheld: tuple[Withheld, ...]
    tested: Evidence = field(repr=False)
    data: DataSet = field(repr=False)
    search: Search = field(repr=False)

    def within_formulas(self) -> list[str]:
        """Return a line for each joint that fails where effects of the model may have left all of it by their formulas;
        none where a joint is left more.
        """
        judged, names = _Judged(self.search, self.selected), self.data.structure.robot.joints
        failing = [j for j, fit in enumerate(self.fits) if fit.fails]
        errors = {j: {label: float(error[j]) for label, error in self.data.known_errors.items()} for j in failing}
        if not judged.complete or not all(any(of.values()) for of in errors.values()):
            return []
        out = []
        for j, of in errors.items():
            out.append(
                f"{names[j]}: what is left is {judged.remainder[j]:.2g} times what the formulas of effects that the"
                f" model has (above all {max(of, key=lambda label: of[label])}) and noise may leave"
            )
        return out

    @property
    def complete(self) -> bool:
        """Whether the set leaves no joint more than formulas, the least torque and noise do."""
        return _Judged(self.search, self.selected).complete

    def shares_with(self, selected: Selected) -> Mapping[str, float]:
        """Return by label the least share of the excess of a joint that it touches which another set explains of motion
        left out.
        """
        judged = _Judged(self.search, selected)
        return {h.label: min(float(judged.share[j]) for j in judged.touched(h)) for h in selected}

    def probability(self, label: str) -> float:
        """Return the probability of a selected effect: the share of the resamples that it wins, times one less
        the chance.
        """
        return 0.0 if self.election is None else self.election.probability(label) * (1.0 - self.chances[label])


def select(
    measurements: Sequence[Measurement],
    structure: Structure,
    validation: Sequence[Measurement] = (),
    tell: Tell = silent,
    *,
    floor: bool = True,
) -> Selection:
    """Select what a model lacks; validation recordings are never fitted. floor: whether rows are in units of the noise
    of recordings that tell it, or of what the model leaves.
    """
    rows = Rows.of(measurements, structure, validation, floor=floor)
    fits = lack_of_fit(rows.tested, base_gram(rows.tested)) if rows.floor else ()
    tell(0.3, "trying every effect")
    data = DataSet(rows)
    search = Search(data)
    for given, joints in search.first_looks():
        add_backlash(given, joints)
        add_ripples(given, joints)
    tell(0.5, "searching for the set that predicts best")
    settled = _Settled.of(search)
    vague = _vague(search, settled)
    if any(not search.size_known(h, settled.selected) for h in vague) and any(fit.fails for fit in fits):
        wider = search.with_size_error(COMPLETE_SIZE_ERROR)
        complete = _Settled.of(wider)
        if not complete.withheld and _Judged(wider, complete.selected).complete:
            search, settled, vague = wider, complete, _vague(wider, complete)
    return Selection(
        settled.selected,
        vague,
        settled.election,
        settled.chances,
        fits,
        settled.withheld,
        rows.tested,
        data=data,
        search=search,
    )


@dataclass(frozen=True)
class _Settled:
    """The set that a search ends with, where no name of it is contradicted or chance, and what was withheld on the way.

    chances: by label, that noise of the spectrum of what is left explains as much by some effect.
    """

    selected: Selected
    election: Election | None
    chances: Mapping[str, float]
    withheld: tuple[Withheld, ...]

    @classmethod
    def of(cls, search: Search) -> _Settled:
        """Search until no further joint has an unknown cause, and elect among the neighbours."""
        withheld: list[Withheld] = []
        while True:
            selected = search.run()
            unknown, barred, why = _Judged(search, selected).unknown()
            withheld += why
            if unknown <= search.unknown and barred <= search.barred:
                break
            search.unknown |= unknown
            search.barred |= barred
        selected = _without(selected, why)
        election = elect(search, selected) if selected else None
        if election is not None and election.winner != selected:
            _, _, why = _Judged(search, election.winner).unknown()
            selected, withheld = _without(election.winner, why), [*withheld, *why]
        selected, chances, why = _told_from_noise(search, selected)
        return cls(selected, election, chances, (*withheld, *why))


def _told_from_noise(search: Search, selected: Selected) -> tuple[Selected, Mapping[str, float], list[Withheld]]:
    """Return a set without the effects, one after the other, of which noise may be the cause, and every chance. Asked
    where noise is measured, too: what repeats of a disturbance from period to period is not in it.
    """
    withheld: list[Withheld] = []
    while selected:
        chance = Chance(search, selected)
        chances = {h.label: chance.of(h) for h in selected}
        label, most = max(chances.items(), key=lambda pair: pair[1])
        if most <= CHANCE:
            return selected, chances, withheld
        why = (
            "noise of the same spectrum lets some effect of its joints explain as much in"
            f" {100 * min(most, 1.0):.3g} % of cases ({100 * CHANCE:g} % asked); record longer, or another motion"
        )
        withheld.append(Withheld(label, why))
        selected = _without(selected, withheld[-1:])
    return selected, {}, withheld


def _vague(search: Search, settled: _Settled) -> Selected:
    """Return by joint the best effect that predicts what a set leaves, and whose size is not known well enough, or
    which so few lines of the motion do not tell from chance.
    """
    out: dict[int, Hypothesis] = {}
    selected, withheld = settled.selected, {one.label for one in settled.withheld}
    for gain, h in search.ranked(selected):
        if gain <= 0.0 or h.label in withheld:
            continue
        known = search.size_known(h, selected)
        if not known and search.size_error_of(h, selected) > VAGUE:
            continue
        if not search.predicts(h, selected, beyond_chance=not known):
            continue
        judged = _Judged(search, (*selected, h))
        if not judged.why_not(h):
            out.setdefault(judged.main[h.label], h)
    return tuple(out.values())


def _without(selected: Selected, withheld: Sequence[Withheld]) -> Selected:
    refused = {one.label for one in withheld}
    return tuple(h for h in selected if h.label not in refused)


class _Judged:
    """A set held against what it leaves of each joint."""

    def __init__(self, search: Search, selected: Selected) -> None:
        self.search, self.selected = search, selected
        data = search.data
        training = slice(0, data.training)
        self.given = search.given(selected)
        self.before = search.given(()).loss[training].sum(axis=0)
        after = self.given.loss[training].sum(axis=0)
        dof = data.dof[training].sum(axis=0)
        self.excess = np.maximum(self.before - data.noise, 1.0)
        self.share = (self.before - after) / self.excess
        self.main = {h.label: self._main(h) for h in selected}
        wrong = search.formula_error(selected) * data.training / len(data.folds)
        self.least = least = data.weights[training].sum(axis=0) * data.least
        remainder = self.given.excess() / (wrong + least + 2.0 * np.sqrt(2.0 * np.maximum(dof, 1.0)))
        self.remainder = remainder * data.floor

    @property
    def complete(self) -> bool:
        """Whether no joint has more left than formulas, the least torque and two standard deviations of noise."""
        return bool(np.all(self.remainder <= 1.0))

    def _main(self, h: Hypothesis) -> int:
        """Return the joint on which a selected effect matters most."""
        rest = [x for x in self.selected if x is not h]
        fall = ((self.search.given(rest).loss - self.given.loss) / self.search.dispersion).sum(axis=0)
        return max(h.joints, key=lambda j: float(fall[j]))

    def unknown(self) -> tuple[set[int], set[str], list[Withheld]]:
        """Return the joints whose cause is none of the catalogue, the effects of several joints that are none of the
        causes, and what is withheld.
        """
        joints: set[int] = set()
        labels: set[str] = set()
        why: list[Withheld] = []
        for h in self.selected:
            joint = self.main[h.label]
            reason = self.why_not(h)
            if reason:
                why.append(Withheld(h.label, reason))
                if len(h.joints) > 1:
                    labels.add(h.label)
                if len(h.joints) == 1 or h.effect.joint == joint and not h.effect.whole:
                    joints.add(joint)
        for joint in range(self.search.data.n):
            group = [h for h in self.selected if h.effect.over_position and h.effect.joint == joint]
            if len(group) > 1 and joint not in joints:
                kept, reason = self._one_curve(group, joint)
                nameless = [h.label for h in group if reason and h is not kept]
                why += [Withheld(label, reason) for label in nameless]
                if kept is not None:
                    labels.update(nameless)
                elif nameless:
                    joints.add(joint)
        return joints, labels, why

    def why_not(self, h: Hypothesis) -> str:
        """Return why an effect is not named, were it alone on its joint; empty where nothing speaks against it."""
        return self._remainder(h) or self._split(h) or self._flexible(h)

    def _one_curve(self, group: Sequence[Hypothesis], joint: int) -> tuple[Hypothesis | None, str]:
        """Return why several effects over one joint's position are no several causes: any curve over it predicts as
        well as they do; and the one that alone leaves no more than formulas and noise do.
        """
        rest = [h for h in self.selected if h not in group]
        curve = flexible_beside(self.search.given(rest), joint, curve_of)
        losses = self.given.block_losses()
        leads = [loss - losses[f][:, joint] for f, loss in enumerate(curve.losses)]
        if standard_errors(np.concatenate(leads)) > STANDARD_ERRORS:
            return None, ""
        alone = {h: _Judged(self.search, (*rest, h)) for h in group}
        enough = [h for h, judged in alone.items() if judged.remainder[joint] <= REMAINDER]
        best = min(enough, key=lambda h: float(alone[h].given.loss[:, joint].sum()), default=None)
        name = self.search.data.structure.robot.joints[joint]
        return best, f"{' and '.join(h.label for h in group)} together predict no better than one curve over {name}"

    def _remainder(self, h: Hypothesis) -> str:
        """Return whether more is left on a joint that an effect touches than formulas and noise leave."""
        for j in () if h.own_friction else self.touched(h):
            if self.remainder[j] > REMAINDER:
                name = self.search.data.structure.robot.joints[j]
                return f"the remainder of {name} is {self.remainder[j]:.2g} times what formulas and noise leave"
        return ""

    def touched(self, h: Hypothesis) -> list[int]:
        """Return the joint on which a selected effect matters most, and the others where its torque is seen."""
        data, contribution = self.search.data, self.given.contribution(h)
        seen = self.least + 2.0 * np.sqrt(2.0 * data.dof[: data.training].sum(axis=0))
        return [j for j in h.joints if j == self.main[h.label] or contribution[j] > seen[j]]

    def _split(self, h: Hypothesis) -> str:
        """Return whether an effect changes with something that it does not depend on; not asked where noise is not
        known: all else that the model lacks changes over the path, and the parts of any effect follow it.
        """
        data = self.search.data
        if not data.floor:
            return ""
        rest = self.search.given([x for x in self.selected if x is not h])
        allowed = float(self.search.formula_error(self.selected)[list(h.joints)].sum())
        found = list(splits(rest, h))
        choice = 2.0 * np.log(max(2, len(found)))
        for split in found:
            cost = allowed + choice + split.parameters * np.log(data.block_count)
            if split.more > cost and split.errors > STANDARD_ERRORS:
                return f"its size changes {split.words}, so that something else acts there"
        return ""

    def _flexible(self, h: Hypothesis) -> str:
        """Return whether a flexible model predicts a joint better than the selected effects do; of friction, a flexible
        model of friction.
        """
        joint = self.main[h.label]
        if self.share[joint] >= 1.0 - FLEXIBLE_SHARE:
            return ""
        flexible = flexible_beside(self._of_other_joints(joint), joint, friction_of if h.own_friction else groups_of)
        losses = self.given.block_losses()
        falls = [losses[f][:, joint] - loss for f, loss in enumerate(flexible.losses)]
        share = (self.before[joint] - flexible.total) / self.excess[joint]
        if share - self.share[joint] > FLEXIBLE_SHARE and standard_errors(np.concatenate(falls)) > FLEXIBLE_ERRORS:
            return f"a flexible model explains {100 * share:.0f} %, the effects {100 * self.share[joint]:.0f} %"
        return ""

    def _of_other_joints(self, joint: int) -> FittedSet:
        return self.search.given([h for h in self.selected if self.main[h.label] != joint])
