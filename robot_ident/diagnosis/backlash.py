"""Backlash shows as bursts: recognised by where the energy lies, and laid to the joint whose gap makes such bursts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.candidates import Folds, Score, candidate_of, score
from robot_ident.diagnosis.evidence import Evidence, Trajectory, fitted, kept_between_parts
from robot_ident.diagnosis.hidden_path import residual_beside_hidden_path
from robot_ident.diagnosis.refine import refined
from robot_ident.diagnosis.unseen import Unseen
from robot_ident.effects.backlash import Backlash
from robot_ident.motion import Array, Mask

FAST = 5.0  # Hz: slower than this no burst is
SHARE_FAST = 0.35  # of the excess energy that must lie above FAST: something else may be there, too
SHARE_NEAR = 0.65  # of the fast energy that must lie after a reversal of the load
CHANCE = 0.3  # beyond the share that chance would put there
AFTER = 0.25  # s after a reversal within which its burst dies away
RINGS = 0.4  # s after a reversal within which hardly anything of it is left
GAIN = 40.0  # chi-square units that the column of a gap must gain


def gap_behind(evidence: Evidence, folds: Folds, rattling: Sequence[int]) -> Score | None:
    """Return the gap whose column follows the bursts of some joints best, of all joints; None where none does.

    Bursts alone don't say whose they are where the loads of several joints reverse together.
    """
    if not any(burst_cause(evidence, joint) is not None for joint in rattling):
        return None
    return best_gap(evidence, folds, range(evidence.structure.robot.n))


def best_gap(evidence: Evidence, folds: Folds, joints: Collection[int]) -> Score | None:
    """Return the gap at one of some joints that gains most, refined; None where none gains enough, held out, too."""
    robot = evidence.structure.robot
    possible = [Backlash(robot, joint) for joint in joints if not Backlash.available(robot, joint)]
    effects = [effect for effect in possible if effect.label not in evidence.structure.labels]
    candidates = [candidate_of(effect, evidence) for effect in effects if not effect.unseen]
    scores = [score(candidate, evidence, folds) for candidate in candidates if candidate.columns]
    best = max(scores, key=lambda s: s.gain, default=None)
    if best is None or best.gain < GAIN or best.held_out < GAIN / 2:
        return None
    return refined(best, evidence, folds)


def muted(
    evidence: Evidence, unseen: Unseen | None, rattling: Mapping[int, Collection[int]]
) -> tuple[Evidence, Unseen | None]:
    """Return the evidence, and recordings kept aside, without the time after load reversals in which joints rattle.

    rattling: by joint, whose gaps make it rattle. What else is missing shows in the time between.
    """
    loads = [torques.load for torques in evidence.torques]
    quiet = tuple(_quiet(t, load, rattling) for t, load in zip(evidence.trajectories, loads, strict=True))
    less = fitted(evidence.structure, quiet, evidence.rigid, kept_between_parts(evidence))
    if unseen is None:
        return less, None
    aside = tuple(_quiet(t, x.load, rattling) for t, x in zip(unseen.trajectories, unseen.torques, strict=True))
    return less, replace(unseen, trajectories=aside).under(less)


def _quiet(t: Trajectory, load: Array, rattling: Mapping[int, Collection[int]]) -> Trajectory:
    weight, reach = t.weight.copy(), round(RINGS / t.measured.dt)
    for joint, causes in rattling.items():
        for cause in causes:
            weight[_after_reversals(load[:, cause], reach)[t.measured.rows], joint] = 0.0
    share = (weight > 0).sum(axis=0) / np.maximum(1, (t.weight > 0).sum(axis=0))
    return replace(t, weight=weight, y=np.where(weight > 0, t.y, 0.0), dof=t.dof * share)


def burst_cause(evidence: Evidence, joint: int) -> int | None:
    """Return the joint after whose load reversals the bursts in a joint's residual come, None where it has no bursts.

    A gap in one joint rattles its neighbours too; the bursts tell by their times whose it is.
    """
    n = evidence.structure.robot.n
    fast = excess = 0.0
    near, chance = np.zeros(n), np.zeros(n)
    for trajectory, residual in zip(evidence.trajectories, residual_beside_hidden_path(evidence), strict=True):
        measured = trajectory.measured
        if measured.base_frequency is None or measured.decimate != 1:
            return None
        r = residual[:, joint]
        high, lines = _fast_part(r, measured.base_frequency)
        excess += float(np.sum(r**2)) - float(trajectory.dof[joint])
        fast += float(np.sum(high**2)) - lines
        load = evidence.structure.torques(trajectory.motion, evidence.values).load
        for other in range(n):
            rows = _after_reversals(load[:, other], round(AFTER / measured.dt))
            share = float(rows.mean())
            near[other] += float(np.sum(high[rows] ** 2)) - lines * share
            chance[other] += share / len(evidence.trajectories)
    if excess <= 0.0 or fast <= SHARE_FAST * excess:
        return None
    beyond = near / fast - chance
    cause = int(np.argmax(beyond))
    return cause if near[cause] > max(SHARE_NEAR, chance[cause] + CHANCE) * fast else None


def _fast_part(residual: Array, frequency: float) -> tuple[Array, float]:
    """Return a residual [N] above FAST, and the energy that noise alone has there (in units of its variance)."""
    spectrum = np.fft.rfft(residual)
    spectrum[np.arange(len(spectrum)) * frequency < FAST] = 0.0
    return np.fft.irfft(spectrum, len(residual)), 2.0 * float(np.sum(spectrum != 0.0))


def _after_reversals(load: Array, reach: int) -> Mask:
    """Return the samples that follow a change of sign of the load within `reach`, or precede it by a tenth of that."""
    change = np.flatnonzero(np.sign(load) != np.sign(np.roll(load, 1)))
    rows = np.zeros(len(load), dtype=bool)
    for place in change:
        rows[np.arange(place - reach // 10, place + reach) % len(load)] = True
    return rows
