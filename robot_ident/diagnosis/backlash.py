"""Backlash shows as bursts: recognised by where the energy lies, and laid to the joint whose gap makes such bursts."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from robot_ident.diagnosis.candidates import Candidate, Folds, Score, candidate_of, score, score_grams
from robot_ident.diagnosis.evidence import Evidence, Trajectory, fitted, kept_between_parts
from robot_ident.diagnosis.hidden_path import residual_beside_hidden_path
from robot_ident.diagnosis.scan import add, columns_of, gram
from robot_ident.diagnosis.unseen import Unseen
from robot_ident.effects import Effect
from robot_ident.effects.backlash import Backlash
from robot_ident.signals.motion import Array, Mask

FAST = 5.0  # Hz: slower than this no burst is
SHARE_FAST = 0.35  # of the excess energy that must lie above FAST: something else may be there, too
SHARE_NEAR = 0.65  # of the fast energy that must lie after a reversal of the load
CHANCE = 0.3  # beyond the share that chance would put there
AFTER = 0.25  # s after a reversal within which its burst dies away
RINGS = 0.4  # s after a reversal within which hardly anything of it is left
SIGN = 6.0  # chi-square units that a gap's column must gain at a glance, over a part of its grid
GAIN = 40.0  # chi-square units that the column of a gap must gain
SHARE_OF_BLOW = 0.4  # of the blow that a gap makes which must be there; as many times more is too much
STEPS, STEP = 5, 2e-3  # of the search for a gap's inner parameters: how many, and the differences' in their ranges


def gap_behind(evidence: Evidence, folds: Folds, rattling: Sequence[int], joints: Collection[int]) -> Score | None:
    """Return the gap at one of some joints whose column follows the bursts of rattling ones best; None where none does.

    Bursts alone don't say whose they are where the loads of several joints reverse together.
    """
    if not any(burst_cause(evidence, joint) is not None for joint in rattling):
        return None
    return best_gap(evidence, folds, joints)


def best_gap(evidence: Evidence, folds: Folds, joints: Collection[int]) -> Score | None:
    """Return the gap at one of some joints that gains most, refined; None where none gains enough, held out, too."""
    robot = evidence.structure.robot
    possible = [Backlash(robot, joint) for joint in joints if not Backlash.available(robot, joint)]
    effects = [effect for effect in possible if effect.label not in evidence.structure.labels]
    scores = [found for e in effects if not e.unseen and (found := _of_grid(e, evidence, folds)) is not None]
    best = max(scores, key=lambda s: s.gain, default=None)
    return None if best is None or best.gain < GAIN / 2 else gap_near(best.effect, evidence, folds)


def _of_grid(effect: Effect, evidence: Evidence, folds: Folds) -> Score | None:
    """Return a gap at the best setting of its grid; None where, at the first value of all but its width, it gains no
    more than chance at any.
    """
    settings = effect.settings()
    first = settings[0]
    plain = [s for s in settings if all(value == first[name] for name, value in s.items() if name != "gap")]
    glance = candidate_of(effect, evidence, plain)
    if not glance.columns or score(glance, evidence, folds).gain < SIGN:
        return None
    return score(candidate_of(effect, evidence), evidence, folds)


def gap_near(effect: Effect, evidence: Evidence, folds: Folds) -> Score | None:
    """Return a gap with its inner parameters refined from those that it has; None where it does not gain enough, held
    out, too, or where the blows are not as large as such a gap makes them.
    """
    torques = evidence.torques
    effect = _fitted(effect, evidence, folds)
    columns = columns_of(effect, evidence, torques)
    if not columns.joints:
        return None
    inner = gram(columns, evidence)
    found = score_grams(Candidate(effect.label, (columns,)), [inner], folds)
    share = float(add(inner, folds.whole, effect.ranges).coefficients[0])
    as_large = SHARE_OF_BLOW <= share <= 1.0 / SHARE_OF_BLOW
    return found if as_large and found.gain >= GAIN and found.held_out >= GAIN / 2 else None


def _fitted(effect: Effect, evidence: Evidence, folds: Folds) -> Effect:
    """Return a gap with its inner parameters where the squared error is least: variable projection, all of the data
    together. What the model's torque tells of the load is taken as it stands.
    """
    from scipy.optimize import least_squares

    torques = evidence.torques
    axes = [inner for inner in effect.inner if inner.continuous]
    low, high = (np.array([i.scaled(getattr(i, side)) for i in axes]) for side in ("lower", "upper"))

    def at(x: Array) -> Effect:
        places = low + (high - low) * np.clip(x, 0.0, 1.0)
        return effect.at({i.name: i.unscaled(place) for i, place in zip(axes, places.tolist(), strict=True)})

    def rest(x: Array) -> Array:
        columns = columns_of(at(x), evidence, torques)
        joints = list(columns.joints)
        addition = add(gram(columns, evidence), folds.whole, effect.ranges)
        out = []
        for t, phi, part in zip(evidence.trajectories, evidence.phi, columns.parts, strict=True):
            left = t.y - phi @ addition.values
            left[:, joints] -= part @ addition.coefficients
            out.append(left.ravel())
        return np.concatenate(out)

    start = (np.array([i.scaled(effect.setting[i.name]) for i in axes]) - low) / (high - low)
    found = least_squares(rest, np.clip(start, 1e-6, 1 - 1e-6), bounds=(0.0, 1.0), diff_step=STEP, max_nfev=STEPS)
    return at(found.x)


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
    return t.weighed_by(weight)


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
