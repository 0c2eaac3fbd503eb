"""Which rivals can the data not tell from the best candidate?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.diagnosis.candidates import Folds, Score
from robot_ident.diagnosis.evidence import Evidence, Trajectory
from robot_ident.diagnosis.scan import Columns, add, gram
from robot_ident.signals.motion import Array

BLOCK = 0.5  # s: residuals further apart are taken as independent
_Z = 2.0  # standard errors of the mean difference of block losses below which two candidates are tied
_SHARE = 0.02  # of the best gain: a smaller lead is no lead
_RIVAL = 0.4  # of the best held-out gain that a rival must reach to be looked at
_CHANCE = 0.001  # probability that further parameters gain so much where there is nothing for them: many effects try


def tied(best: Score, scores: Sequence[Score], evidence: Evidence, folds: Folds) -> list[Score]:
    """Return the rivals whose held-out loss does not differ significantly from that of one score, best first; and those
    with fewer parameters that fit all of the data as well, but for what so many more gain by chance (99.9 % of
    chi-square): of these, extrapolation alone thinks less.
    """
    from scipy.special import chdtri

    if best.held_out <= 0.0:
        return []
    reference = block_losses(best, evidence, folds)
    out = []
    for rival in scores:
        if rival is best or rival.held_out < _RIVAL * best.held_out or not set(rival.mainly) & set(best.mainly):
            continue
        if best.label.partition("@")[0] in type(rival.effect).contains:
            continue  # what holds the best as a part can't be told from it, and says nothing more
        further = best.effect.size - rival.effect.size
        as_well = further > 0 and rival.gain >= best.gain - chdtri(further, _CHANCE)
        if as_well or alike(block_losses(rival, evidence, folds) - reference, best.held_out):
            out.append(rival)
    return sorted(out, key=lambda score: -score.held_out)


def alike(lead: Array, gain: float) -> bool:
    """Return whether two explanations predict alike: differences of their block losses, and what the better gains."""
    return abs(float(lead.sum())) < _SHARE * gain or not significant(lead)


def significant(lead: Array) -> bool:
    """Return whether the sum of differences of block losses is more than their scatter makes."""
    return abs(float(lead.sum())) >= _Z * float(np.std(lead, ddof=1)) * np.sqrt(len(lead))


def block_losses(score: Score, evidence: Evidence, folds: Folds) -> Array:
    """Return the squared error in blocks of time of every trajectory left out or unseen, at the score's setting."""
    columns: Columns = score.columns
    inner = gram(columns, evidence)
    losses = []
    for left, fit in enumerate(folds.without):
        addition = add(inner, fit, score.effect.ranges)
        trajectory = evidence.trajectories[left]
        residual = trajectory.y - evidence.phi[left] @ addition.values
        residual[:, columns.joints] -= columns.parts[left] @ addition.coefficients
        losses += in_blocks(residual, trajectory)
    if folds.unseen is not None:
        rests = folds.unseen.residuals(score.effect, add(inner, folds.whole, score.effect.ranges))
        for residual, trajectory in zip(rests, folds.unseen.trajectories, strict=True):
            losses += in_blocks(residual, trajectory)
    return np.array(losses)


def in_blocks(residual: Array, trajectory: Trajectory) -> list[float]:
    """Return the squared error of a trajectory's residual [N, n] in blocks of time."""
    squared = np.sum(residual**2, axis=1)
    size = max(1, round(BLOCK / (trajectory.measured.dt * trajectory.measured.decimate)))
    used = np.flatnonzero(trajectory.weight.any(axis=1))
    span = squared[used[0] : used[-1] + 1] if len(used) else squared
    return [float(block.sum()) for block in np.array_split(span, max(1, len(span) // size))]
