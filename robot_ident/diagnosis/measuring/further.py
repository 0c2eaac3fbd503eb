"""Faults that are further columns: a load in one of the recordings, a joint that stands elsewhere."""

from __future__ import annotations

from functools import partial

import numpy as np

from robot_ident.diagnosis.before_after import spread
from robot_ident.diagnosis.diagnosis import Estimate
from robot_ident.diagnosis.measuring.fitted_fault import FittedFault, fitted_loss, with_columns
from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import BaseGram, Columns, Folds, add, base_gram, columns_of, gram, loss_with
from robot_ident.regression.misfit import lack_of_fit
from robot_ident.signals.motion import Array

_SIGMA = 2.0
_FARTHEST = 250.0  # mm by which a link may be longer or shorter than described; more, and the robot is another one


def link_lengths(evidence: Evidence, folds: Folds) -> list[FittedFault]:
    """Return for every joint but the first where its origin may lie, by the torque's derivative with it."""
    robot, out = evidence.structure.robot, []
    for joint in range(1, robot.n):
        effect = CATALOGUE["link_length"](robot, joint)
        moved = columns_of(effect, evidence, evidence.torques)
        gain, held_out = _falls(moved, evidence, folds)
        if held_out <= 0.0:
            continue
        after = with_columns(evidence, partial(_beside, moved=moved))
        values = after.values[-3:]
        std = _spread(after)[-3:]
        if any(abs(v) - s > _FARTHEST for v, s in zip(values, std, strict=True)):
            continue
        told = tuple(
            Estimate(f"{axis} of {robot.joints[joint]}", float(v), float(s), "mm")
            for axis, v, s in zip("xyz", values, std, strict=True)
            if s < abs(v)
        )
        fix = (
            f"the URDF, joint {robot.joints[joint]}: its origin xyz by {' '.join(f'{1e-3 * v:.4f}' for v in values)} m"
            " (only what the torque tells of it)"
        )
        out.append(FittedFault(effect, gain, held_out, told, partial(_moved, joint=joint), fix, 3))
    return out


def _falls(columns: Columns, evidence: Evidence, folds: Folds) -> tuple[float, float]:
    """Return the fall of the squared error of all data and of trajectories left out with further columns."""
    inner, free = gram(columns, evidence), [(-np.inf, np.inf)] * columns.parts[0].shape[2]
    left_out = [loss_with(inner, folds.base, add(inner, fit, free), left) for left, fit in enumerate(folds.without)]
    return add(inner, folds.whole, free).gain, float(folds.loss.sum() - np.sum(left_out))


def payloads(evidence: Evidence, base: BaseGram) -> list[FittedFault]:
    """Return for every recording the load by which it differs from the others; needs two recordings. A load whose mass
    may be zero, though the torque tells it, is one only where it leaves nothing: a tool that was turned.
    """
    sources = evidence.recordings
    if len(sources) < 2:
        return []
    everything = range(len(base.power))
    before, out = fitted_loss(base, everything), []
    robot = evidence.structure.robot
    for place, source in enumerate(sources):
        columns = partial(_loaded, place=place)
        after = with_columns(evidence, columns)
        with_load = base_gram(after)
        gain = before - fitted_loss(with_load, everything)
        weight, std = _gravity_change(after)
        weightless = np.isfinite(std) and abs(weight) < _SIGMA * std
        if len(sources) == 2 and weight < -_SIGMA * std:
            continue  # what the one lacks the other carries: told of that one
        if weightless and any(fit.fails for fit in lack_of_fit(after, with_load)):
            continue
        fix = (
            f"{source.source}.conditions.yaml: payload: estimate  # or its mass, com and inertia"
            if weight >= 0.0
            else f"the other recordings' .conditions.yaml: a payload that {source.source} lacks"
        )
        told = (Estimate(f"mass change in recording {place + 1}", weight, std, "kg"),) if np.isfinite(std) else ()
        effect = CATALOGUE["payload"](robot, None)
        out.append(FittedFault(effect, gain, gain - 10.0, told, columns, fix, 10, place + 1))
    return out


def _moved(evidence: Evidence, *, joint: int) -> tuple[Array, ...]:
    effect = CATALOGUE["link_length"](evidence.structure.robot, joint)
    return _beside(evidence, columns_of(effect, evidence, evidence.torques))


def _beside(evidence: Evidence, moved: Columns) -> tuple[Array, ...]:
    """Return the model's columns with those of a joint's three directions."""
    out = []
    for phi, part in zip(evidence.phi, moved.parts, strict=True):
        more = np.zeros((*phi.shape[:2], 3))
        more[:, moved.joints] = part
        out.append(np.concatenate([phi, more], axis=2))
    return tuple(out)


def _loaded(evidence: Evidence, *, place: int) -> tuple[Array, ...]:
    """Return the columns with ten more: the last link's, in one recording alone."""
    order = list(dict.fromkeys(id(t.measured) for t in evidence.trajectories))
    effect = CATALOGUE["payload"](evidence.structure.robot, None)
    out = []
    for t, phi in zip(evidence.trajectories, evidence.phi, strict=True):
        if order.index(id(t.measured)) == place:
            more = t.weighed(effect.full_columns(t.motion))
        else:
            more = np.zeros((*phi.shape[:2], 10))
        out.append(np.concatenate([phi, more], axis=2))
    return tuple(out)


def _gravity_change(after: Evidence) -> tuple[float, float]:
    """Return the change of mass that the ten further parameters tell, and its standard deviation (inf: untold)."""
    std = _spread(after)
    return float(after.values[-10]), float(std[-10])


def _spread(after: Evidence) -> Array:
    """Return standard deviations [p] of a fit, errors of the model counted; inf for what the data leave open."""
    base = base_gram(after)
    own = base.own.sum(axis=(0, 1))
    scale = np.sqrt(np.maximum(np.diag(own), 1e-300))
    values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
    told = values > 1e-9 * values.max()
    open_ = (vectors[:, ~told] ** 2).sum(axis=1) > 1e-6
    return np.where(open_, np.inf, spread(after, after.phi))
