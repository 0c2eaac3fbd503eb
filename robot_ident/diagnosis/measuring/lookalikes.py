"""A low pass over the effort beside the effects that look like it: which of them do the data tell for, if any?

To what is slow, a low pass, a delay and friction that builds up after a reversal are all torque that comes late. They
are held against each other by what they predict of trajectories left out, block by block of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.diagnosis.candidates import Folds, Score
from robot_ident.diagnosis.diagnosis import Diagnosis, Suspect
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.measuring.filtered import NAME, exact, filters
from robot_ident.diagnosis.measuring.finding import Finding, folds
from robot_ident.diagnosis.refine import refined, sharpened
from robot_ident.diagnosis.scan import BaseFit, base_gram
from robot_ident.diagnosis.ties import alike, block_losses, in_blocks, significant
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.signals.motion import Array

LIKE = CATALOGUE[NAME].confused_with
"""Names of the effects that look like a low pass."""

_SMOOTHED = "viscous_nonlinear"  # friction that turns as smoothly as a filter without phase makes any turn
_DELAY = "time_delay"  # of these the one that is of the measuring, too, and has less parameters
_CLEAR = 0.08  # of its held-out gain by which a low pass must lead a delay: a joint that sticks turns steps into ramps
_HEARD = 0.4  # of a low pass's held-out gain from which on an effect is held against it


@dataclass(frozen=True)
class LowPasses:
    """Low passes that the data may tell of, over the grid, and what they were judged on."""

    found: tuple[Finding, ...]
    evidence: Evidence
    folds: Folds
    scores: Sequence[Score]

    def beside(self, diagnosis: Diagnosis) -> Diagnosis:
        """Return a diagnosis whose suspects say where a low pass in their place predicts as well, and what to change
        where the measuring is at fault.
        """
        return replace(diagnosis, missing=tuple(self._beside(with_line(suspect)) for suspect in diagnosis.missing))

    def _beside(self, suspect: Suspect) -> Suspect:
        mine = next((s for s in self.scores if s.label == suspect.label), None)
        given = next((f for f in self.found if f.effect.place == suspect.effect.place), None)
        if suspect.effect.name not in (*LIKE, _SMOOTHED) or mine is None or given is None:
            return suspect
        score = refined(mine, self.evidence, self.folds)
        low_pass = exact(given, self.evidence, self.folds.base)
        lead = block_losses_of(low_pass, self.evidence) - block_losses(score, self.evidence, self.folds)
        if float(lead.sum()) > 0.0 and not alike(lead, score.held_out):
            return suspect
        return _tied(suspect, low_pass)


def with_low_pass(suspect: Suspect, before: Evidence, after: Evidence) -> Suspect:
    """Return a suspect that says where a low pass in its place predicts as well; before, after: without and with it."""
    if suspect.effect.name not in (*LIKE, _SMOOTHED):
        return suspect
    base = base_gram(before)
    given = next((f for f in filters(before, base) if f.effect.place == suspect.effect.place), None)
    if given is None:
        return suspect
    low_pass = exact(given, before, base)
    lead = block_losses_of(low_pass, before) - _block_losses(after, after.phi)
    held_out = float(Folds.of(base).loss.sum() - Folds.of(base_gram(after)).loss.sum())
    return suspect if float(lead.sum()) > 0.0 and not alike(lead, held_out) else _tied(suspect, low_pass)


def _tied(suspect: Suspect, low_pass: Finding) -> Suspect:
    if low_pass.label in suspect.tied_with:
        return suspect
    experiment = suspect.experiment or low_pass.effect.experiment
    fix = f"{low_pass.fix} (if it is {low_pass.label})"
    fix = fix if suspect.fix is None else f"{suspect.fix}, or {fix}"
    return replace(suspect, tied_with=(*suspect.tied_with, low_pass.label), experiment=experiment, fix=fix)


def with_line(suspect: Suspect) -> Suspect:
    """Return a delay with the line that takes it out of what is measured, any other suspect as it is."""
    effect = suspect.effect
    if effect.name != _DELAY:
        return suspect
    declared = np.broadcast_to(effect.robot.torque_delay, (effect.robot.n,))[effect.joint if effect.place else 0]
    line = f"torque_delay: {float(declared) + suspect.parameters[0].value / 1000.0:.4g}"
    if effect.place is not None:
        line = f"joints: {{{effect.place}: {{{line}}}}}"
    return replace(suspect, fix=f"{line}  # s, in the robot YAML")


def holds(low_pass: Finding, scores: Sequence[Score], evidence: Evidence, given: Folds, lead: float) -> bool:
    """Return whether a low pass is what the data tell for.

    It must lead every effect by a margin, but those that look like it: it must predict better than a delay by more than
    stiction makes it, beyond what the noise makes, and not worse than friction does: what the drive does to its signal
    is asked for before the arm is blamed. lead: the margin, in units of chi-square.
    """
    sharp = _sharp(low_pass, scores, evidence, given)
    if not sharp:
        return True
    rival = sharp[0]
    if rival.effect.name not in LIKE:
        return low_pass.held_out - rival.held_out >= lead
    behind = block_losses_of(low_pass, evidence) - block_losses(rival, evidence, given)
    if rival.effect.name == _DELAY:
        return float(behind.sum()) < -_CLEAR * low_pass.held_out and significant(behind)
    return float(behind.sum()) <= 0.0 or not significant(behind)


def equals(low_pass: Finding, scores: Sequence[Score], evidence: Evidence, given: Folds) -> list[str]:
    """Return the labels of effects that predict as well as a low pass."""
    reference, gain = block_losses_of(low_pass, evidence), low_pass.held_out
    sharp = [s for s in _sharp(low_pass, scores, evidence, given) if s.held_out >= _HEARD * gain]
    return [s.label for s in sharp if alike(block_losses(s, evidence, given) - reference, gain)]


def block_losses_of(found: Finding, evidence: Evidence) -> Array:
    """Return the squared error in blocks of time of every trajectory left out, with a fault at its exact values."""
    return _block_losses(evidence, found.columns(evidence))


def _block_losses(evidence: Evidence, phi: Sequence[Array]) -> Array:
    base, losses = base_gram(replace(evidence, phi=tuple(phi))), []
    for left, train in folds(len(phi)):
        trajectory = evidence.trajectories[left]
        losses += in_blocks(trajectory.y - phi[left] @ BaseFit.of(base, train).values, trajectory)
    return np.array(losses)


def _sharp(low_pass: Finding, scores: Sequence[Score], evidence: Evidence, given: Folds) -> list[Score]:
    """Return the scores, best first, refined where they come near the low pass."""
    if not scores or scores[0].held_out < 0.5 * low_pass.held_out:
        return list(scores)
    return sharpened(scores[0], scores, evidence, given)
