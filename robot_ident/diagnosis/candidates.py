"""All effects that might be missing: every one of the catalogue, at every joint, over its inner parameters' grids."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.scan import BaseFit, BaseGram, Columns, Gram, add, columns_of, gram, loss_with
from robot_ident.diagnosis.unseen import Unseen
from robot_ident.effects import Effect, candidates_of
from robot_ident.effects.joint_elasticity import JointElasticity
from robot_ident.signals.motion import Array, joined

_ASIDE = 0.25  # of an effect's gain where it gains most: with less, a joint has its excess from elsewhere


@dataclass(frozen=True)
class Score:
    """How well an effect explains what is missing.

    gain: fall of the squared error over all trajectories, in units of chi-square, at the best setting. held_out: fall
    of the squared error on trajectories left out of the fit, summed over them, and by joint [n]; recordings that no fit
    sees count there, and by themselves in unseen_by_joint [n], None without any. effect: at that setting.
    """

    effect: Effect
    gain: float
    held_out: float
    held_out_by_joint: Array
    columns: Columns
    gram: Gram
    unseen_by_joint: Array | None = None

    @property
    def label(self) -> str:
        """`name@joint`."""
        return self.effect.label

    @property
    def mainly(self) -> list[int]:
        """The joints in which it gains as much as anywhere, or not far less."""
        gains = self.held_out_by_joint
        return [int(j) for j in np.flatnonzero(gains >= _ASIDE * gains.max())]


class _AtOnce(JointElasticity):
    """A gear that follows its load at once, far below its resonance: the one form that this search tries."""

    inner = tuple(
        replace(inner, grid=(value,), continuous=False)
        for inner, value in zip(JointElasticity.inner, (200.0, 0.02), strict=True)
    )

    @property
    def size(self) -> int:
        """Number of its parameters: the compliance alone."""
        return len(self.coefficients)


@dataclass(frozen=True)
class Candidate:
    """An effect with the columns of all its settings."""

    label: str
    columns: tuple[Columns, ...]


def enumerate_candidates(evidence: Evidence, leave_out: Sequence[str] = ()) -> list[Candidate]:
    """Return the candidates that the model doesn't hold and the robot can have."""
    present = {*evidence.structure.labels, *leave_out}
    averaged = all(t.motion.periodic for t in evidence.trajectories)  # trends have a test of their own there
    possible = [e for e in candidates_of(evidence.structure) if not (e.trends and averaged)]
    possible = [_AtOnce(e.robot, e.joint) if type(e) is JointElasticity else e for e in possible]
    made = [candidate_of(e, evidence) for e in possible if e.label not in present]
    return [candidate for candidate in made if candidate.columns]


def candidate_of(
    effect: Effect, evidence: Evidence, settings: Sequence[Mapping[str, float]] | None = None
) -> Candidate:
    """Return an effect with the columns of those of its settings (all, unless told) that the motions show."""
    reached = joined([measured.motion for measured in evidence.recordings])
    settings = effect.settings(reached) or [{}] if settings is None else settings
    columns = [remembered(effect.at(setting), evidence, evidence.torques) for setting in settings]
    return Candidate(effect.label, tuple(c for c in columns if c.joints))


def exactly(effect: Effect) -> Hashable:
    """Return what tells an effect with its inner parameters from any other."""
    return (effect.label, effect.parameter_names(), tuple(sorted(effect.setting.items())))


def remembered(effect: Effect, evidence: Evidence, torques: Sequence[object]) -> Columns:
    """Return the columns of an effect, computed once where they don't depend on the model's torque."""
    if effect.uses_torque:
        return columns_of(effect, evidence, torques)
    key = exactly(effect)
    if key not in evidence.memory:
        evidence.memory[key] = columns_of(effect, evidence, torques)
    found = evidence.memory[key]
    assert isinstance(found, Columns)
    return found


@dataclass(frozen=True)
class Folds:
    """The base fitted to all trajectories and to all but one; `unseen`: recordings that no fit sees, None without."""

    base: BaseGram
    whole: BaseFit
    without: tuple[BaseFit, ...]
    loss: Array
    unseen: Unseen | None = None

    @classmethod
    def of(cls, base: BaseGram, unseen: Unseen | None = None) -> Folds:
        """Fit the base; `loss` [T, n] is its squared error on each trajectory left out."""
        count = len(base.power)
        everything = range(count)
        if count < 2:
            return cls(base, BaseFit.of(base, everything), (), np.zeros((0, base.power.shape[1])), unseen)
        without = tuple(BaseFit.of(base, [t for t in everything if t != left]) for left in everything)
        loss = np.array([fit.loss(base, left) for left, fit in enumerate(without)])
        return cls(base, BaseFit.of(base, everything), without, loss, unseen)


def score(candidate: Candidate, evidence: Evidence, folds: Folds) -> Score:
    """Return a candidate's score; inner parameters are chosen inside each fold, from the trajectories that it fits."""
    grams = [gram(columns, evidence) for columns in candidate.columns]
    return score_grams(candidate, grams, folds)


def score_grams(candidate: Candidate, grams: Sequence[Gram], folds: Folds) -> Score:
    """Return a candidate's score from Gram matrices that are known already."""
    ranges = [columns.effect.ranges for columns in candidate.columns]
    whole = [add(g, folds.whole, limits) for g, limits in zip(grams, ranges, strict=True)]
    gains = [addition.gain for addition in whole]
    best = int(np.argmax(gains))
    by_joint = np.zeros(folds.base.power.shape[1])
    for left, fit in enumerate(folds.without):
        additions = [add(g, fit, limits) for g, limits in zip(grams, ranges, strict=True)]
        chosen = int(np.argmax([addition.gain for addition in additions]))
        by_joint += folds.loss[left] - loss_with(grams[chosen], folds.base, additions[chosen], left)
    effect, unseen = candidate.columns[best].effect, None
    if folds.unseen is not None:
        unseen = folds.unseen.loss(folds.whole) - folds.unseen.loss_with(effect, whole[best])
        by_joint += unseen
    return Score(effect, gains[best], float(by_joint.sum()), by_joint, candidate.columns[best], grams[best], unseen)
