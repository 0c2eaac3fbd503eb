"""A low pass over the effort beside the effects that look like it: which of them do the data tell for, if any?

To what is slow, a low pass, a delay and friction that builds up after a reversal are all torque that comes late. They
are held against each other by what they predict of trajectories left out, block by block of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.diagnosis import Finding
from robot_ident.diagnosis.measuring.filtered import NAME, exact, filters, place_of
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault, folds
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.regression.block_jackknife import rows_in_block
from robot_ident.regression.evidence import Evidence, Trajectory
from robot_ident.regression.gram import BaseFit, Folds, base_gram
from robot_ident.signals.motion import Array

LIKE = CATALOGUE[NAME].confused_with
"""Names of the effects that look like a low pass."""

_SMOOTHED = "viscous_nonlinear"  # friction that turns as smoothly as a filter without phase makes any turn
_DELAY = "time_delay"  # of these the one that is of the measuring, too, and has less parameters
_Z = 2.0  # standard errors of the mean difference of block losses below which two explanations are alike
_SHARE = 0.02  # of the better gain: a smaller lead is no lead


def with_low_pass(finding: Finding, before: Evidence, after: Evidence) -> Finding:
    """Return a finding that says where a low pass in its place predicts as well; before, after: without and with it."""
    if finding.effect.name not in (*LIKE, _SMOOTHED):
        return finding
    base = base_gram(before)
    of_grid = filters(before, base, [place_of(finding.effect)])
    if not of_grid:
        return finding
    low_pass = exact(of_grid[0], before, base)
    lead = block_losses_of(low_pass, before) - _block_losses(after, after.phi)
    held_out = float(Folds.of(base).loss.sum() - Folds.of(base_gram(after)).loss.sum())
    return finding if float(lead.sum()) > 0.0 and not _alike(lead, held_out) else _tied(finding, low_pass)


def _tied(finding: Finding, low_pass: FittedFault) -> Finding:
    if low_pass.label in finding.tied_with:
        return finding
    experiment = finding.experiment or low_pass.effect.experiment
    fix = f"{low_pass.fix} (if it is {low_pass.label})"
    return replace(finding, tied_with=(*finding.tied_with, low_pass.label), experiment=experiment, fix=fix)


def with_line(finding: Finding) -> Finding:
    """Return a delay with the line that takes it out of what is measured, any other finding as it is. Where the torque
    as a whole is late by another time than its steps at reversals, there is no one line: both are told.
    """
    effect = finding.effect
    if effect.name != _DELAY:
        return finding
    delay, steps = finding.parameters[0].value / 1000.0, [p.value for p in finding.parameters[1:]]
    declared = float(np.broadcast_to(effect.robot.torque_delay, (effect.robot.n,))[effect.joint if effect.place else 0])
    line = f"torque_delay: {declared + delay:.4g}"
    line = f"{line if effect.place is None else f'joints: {{{effect.place}: {{{line}}}}}'}  # s, in the robot YAML"
    low, high = (effect.at({"shift": steps[0]}) if steps else effect).ranges[0]
    if not low <= 1000.0 * delay <= high:
        line += f": of the torque as a whole; its steps at reversals are late by {declared + steps[0]:.4g}"
    return replace(finding, fix=line if finding.fix is None else f"{line}, or {finding.fix}")


def block_losses_of(found: FittedFault, evidence: Evidence) -> Array:
    """Return the squared error in blocks of time of every trajectory left out, with a fault at its exact values."""
    return _block_losses(evidence, found.columns(evidence))


def _block_losses(evidence: Evidence, phi: Sequence[Array]) -> Array:
    base, losses = base_gram(replace(evidence, phi=tuple(phi))), []
    for left, train in folds(len(phi)):
        trajectory = evidence.trajectories[left]
        losses += _in_blocks(trajectory.y - phi[left] @ BaseFit.of(base, train).values, trajectory)
    return np.array(losses)


def _alike(lead: Array, gain: float) -> bool:
    """Return whether two explanations predict alike: differences of their block losses, and what the better gains."""
    scatter = float(np.std(lead, ddof=1)) * np.sqrt(len(lead))
    return abs(float(lead.sum())) < max(_SHARE * gain, _Z * scatter)


def _in_blocks(residual: Array, t: Trajectory) -> list[float]:
    """Return the squared error of a trajectory's residual [N, n] in blocks of half a second."""
    squared = np.sum(residual**2, axis=1)
    size = rows_in_block(t.measured)
    used = np.flatnonzero(t.weight.any(axis=1))
    span = squared[used[0] : used[-1] + 1] if len(used) else squared
    return [float(block.sum()) for block in np.array_split(span, max(1, len(span) // size))]
