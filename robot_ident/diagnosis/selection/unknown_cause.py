"""A flexible model of one joint's torque, which stands for causes outside the catalogue.

Smooth curves over positions, direction times such curves, speed, load, memory of the path and waves over pairs of
joints, each group of columns with a prior variance of its own, found by evidence (MacKay 1992). Where it predicts
motion that was not fitted better than the selected effects, the cause is none of the catalogue.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.effects import Torques
from robot_ident.effects.hysteresis import dahl
from robot_ident.signals.motion import Array, Motion

Groups = Callable[[Motion, Torques, int, Array, Array], list[Array]]

_SPEEDS = (0.02, 0.05, 0.1, 0.2, 0.5)  # rad/s at which friction may bend
_REACHES = (0.001, 0.003, 0.01, 0.03)  # rad in which friction may build up
_WAVES = (1, 2, 3)  # a turn
_ROUNDS = 12  # of the prior variances


def groups_of(motion: Motion, torques: Torques, joint: int, low: Array, high: Array) -> list[Array]:
    """Return groups of columns [N, k] Nm; low, high [n]: what positions reach in all recordings."""
    q, v, n = motion.q, motion.dq, motion.joints

    def waves(a: int, b: int) -> Array:
        of = [[f(times * q[:, k]) for f in (np.sin, np.cos) for times in _WAVES] for k in (a, b)]
        return np.array([x * y for x in of[0] for y in of[1]]).T

    near = [k for k in range(n) if k != joint][:3] if n <= 4 else [k for k in (joint - 1, joint + 1) if 0 <= k < n]
    beside = [x for k in near for x in (np.sign(v[:, k]), v[:, k], motion.ddq[:, k])]
    out = [*curve_of(motion, torques, joint, low, high), *friction_of(motion, torques, joint, low, high)]
    out += [np.array(beside).T] if beside else []
    return [*out, *(waves(a, b) for a, b in combinations(sorted({joint, *near}), 2))]


def friction_of(motion: Motion, torques: Torques, joint: int, low: Array, high: Array) -> list[Array]:
    """Return the groups of them that friction of the joint's own drive may make."""
    q, own = motion.q[:, joint], motion.dq[:, joint]
    sign, load = np.sign(own), torques.load[:, joint]
    speed = [sign * np.exp(-np.abs(own) / s) for s in _SPEEDS]
    speed += [np.abs(own), own * np.abs(own), own**2, own**3]
    loaded = [np.abs(load) * sign, load * np.abs(load), load, np.abs(load), np.abs(load) * own]
    memory = [dahl(q, reach, motion.periodic) - sign for reach in _REACHES]
    over_position = sign[:, None] * _bumps(q, low[joint], high[joint], 12)
    return [over_position, *(np.array(group).T for group in (speed, loaded, memory))]


def curve_of(motion: Motion, torques: Torques, joint: int, low: Array, high: Array) -> list[Array]:
    """Return the same groups of a curve over the joint's own position alone."""
    return [_bumps(motion.q[:, joint], low[joint], high[joint], count) for count in (16, 60)]


def _bumps(q: Array, low: float, high: float, count: int) -> Array:
    at = np.linspace(low, high, count)
    return np.asarray(np.exp(-(((q[:, None] - at) / (at[1] - at[0])) ** 2)))


@dataclass(frozen=True)
class Flexible:
    """Squared errors of a joint's blocks by fold, predicted with the flexible model."""

    losses: list[Array]

    @property
    def total(self) -> float:
        """Squared error of all blocks that were predicted."""
        return float(sum(loss.sum() for loss in self.losses))


def flexible_beside(given: FittedSet, joint: int, groups: Groups = groups_of) -> Flexible:
    """Return what base, some effects and a flexible model of a joint predict of its training folds."""
    data = given.data
    folds = range(data.training)
    low = np.min([t.motion.q.min(axis=0) for t in data.folds], axis=0)
    high = np.max([t.motion.q.max(axis=0) for t in data.folds], axis=0)
    sizes: list[int] = []

    def raw(fold: int) -> Array:
        made = groups(data.folds[fold].motion, data.torques[fold], joint, low, high)
        sizes[:] = [some.shape[1] for some in made]
        return np.concatenate(made, axis=1)[:, None]

    columns = [rows[:, 0] for rows in data.in_noise(raw, [joint], data.training)]
    group = np.repeat(np.arange(len(sizes)), sizes)
    rows = [_rows(given, joint, f) for f in folds]
    phi = given.dispersion[:, joint]
    cross = np.array([rows[f].T @ columns[f] / phi[f] for f in folds])
    own = np.array([columns[f].T @ columns[f] / phi[f] for f in folds])
    torque = np.array([columns[f].T @ data.y[joint][f] / phi[f] for f in folds])
    losses = []
    for fit in given.fits[: data.training]:
        (left,) = fit.predicts
        weights = fit.weights[: data.training]
        mixed = np.tensordot(weights, cross, 1)
        square = np.tensordot(weights, own, 1) - mixed.T @ fit.inverse @ mixed
        right = weights @ torque - mixed.T @ fit.values
        rest = sum(
            float((rows[f] @ fit.values - data.y[joint][f]) @ (rows[f] @ fit.values - data.y[joint][f]))
            * weights[f]
            / phi[f]
            for f in folds
        )
        c = _shrunk(square, right, rest, float(weights @ data.dof[: data.training, joint]), group)
        base = fit.values - fit.inverse @ (mixed @ c)
        error = data.y[joint][left] - rows[left] @ base - columns[left] @ c
        losses.append(np.asarray(np.bincount(data.blocks[left], error**2), dtype=float))
    return Flexible(losses)


def _rows(given: FittedSet, joint: int, fold: int) -> Array:
    """Return base and selected effects as a joint's rows [N, q] in a fold."""
    data = given.data
    rows = np.zeros((len(data.y[joint][fold]), given.q))
    rows[:, : data.p] = data.base[joint][fold]
    for h, span in zip(given.selected, given.spans, strict=True):
        if joint in h.at:
            rows[:, span] = data.pools[joint].rows(fold, h.at[joint])
    return rows


def _shrunk(square: Array, right: Array, rest: float, dof: float, group: NDArray[np.intp]) -> Array:
    """Return coefficients whose groups have prior variances by evidence; rest: squared error without them."""
    size = np.sqrt(np.maximum(np.diag(square), 1e-12))
    size[size < 1e-5] = 1.0
    a, r = square / size[:, None] / size, right / size
    count = np.bincount(group)
    precision, noise = np.full(len(count), 1e-2), max(1.0, rest / max(dof, 1.0))
    mean = np.zeros(len(r))
    for _ in range(_ROUNDS):
        covariance = np.linalg.inv(a / noise + np.diag(precision[group]))
        mean = covariance @ r / noise
        determined = count - precision * np.bincount(group, np.diag(covariance))
        squares = np.bincount(group, mean**2)
        precision = np.clip(np.maximum(determined, 1e-3) / np.maximum(squares, 1e-12), 1e-6, 1e8)
        left = rest - 2.0 * mean @ r + mean @ a @ mean
        noise = max(1.0, left / max(dof - determined.sum(), 1.0))
    return np.asarray(mean / size)
