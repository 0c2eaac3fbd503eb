"""Scores candidate columns without refitting the model: what they gain on the data, and on a trajectory they have not
seen.

With base columns F and candidate columns C (Frisch and Waugh) the gain of C is s' B^-1 s, where s and B are C'y and
C'C after projection off F. All of it follows from the Gram matrices of each trajectory, so that leaving one
trajectory out costs a subtraction.

What is left out counts faintly all the same: parameters that the others hardly determine follow it rather than their
noise, which would be all that its error tells of; those that they do determine don't notice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from robot_ident.effects import Effect
from robot_ident.regression.evidence import Evidence, weighed_once
from robot_ident.regression.normal_equations import least_solution, pseudo_inverse
from robot_ident.signals.motion import Array

Ranges = Sequence[tuple[float, float]]
"""The least and the largest that each coefficient can be."""

FAINT = 0.01
"""Weight of a recording that is left out: parameters that only it determines follow it instead of their noise."""

HELD = 1e-9  # of a candidate's own norm: with less than this left after projection the model holds it already


@dataclass(frozen=True)
class Columns:
    """Columns of one effect at one setting, weighed, on each trajectory [N, joints, k], and the joints that they
    touch.
    """

    effect: Effect
    joints: tuple[int, ...]
    parts: tuple[Array, ...]


@dataclass(frozen=True)
class Gram:
    """Inner products of one setting's columns, per trajectory: with the base [T, p, k], themselves [T, k, k], the
    torque [T, k].

    The last two also per joint [T, n, ...], for gains of one joint.
    """

    base: Array
    own: Array
    torque: Array

    @cached_property
    def _of_trajectories(self) -> tuple[Array, Array, Array]:
        return self.base.sum(axis=1), self.own.sum(axis=1), self.torque.sum(axis=1)

    def weighed(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return the three summed over joints and, by weights [T], over trajectories."""
        base, own, torque = self._of_trajectories
        return _weighed(weights, base), _weighed(weights, own), _weighed(weights, torque)


@dataclass(frozen=True)
class BaseGram:
    """Inner products of the base columns per trajectory and joint: [T, n, p, p], [T, n, p], [T, n]."""

    own: Array
    torque: Array
    power: Array

    @cached_property
    def _of_trajectories(self) -> tuple[Array, Array, Array]:
        return self.own.sum(axis=1), self.torque.sum(axis=1), self.power.sum(axis=1)

    def weighed(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return the three summed over joints and, by weights [T], over trajectories."""
        own, torque, power = self._of_trajectories
        return _weighed(weights, own), _weighed(weights, torque), weights @ power


def _weighed(weights: Array, parts: Array) -> Array:
    return (weights @ parts.reshape(len(parts), -1)).reshape(parts.shape[1:])


def base_gram(evidence: Evidence) -> BaseGram:
    """Return the Gram matrices of the model's own columns."""
    own = np.array([np.einsum("ijp,ijq->jpq", phi, phi, optimize=True) for phi in evidence.phi])
    torque = np.array(
        [np.einsum("ijp,ij->jp", phi, t.y) for phi, t in zip(evidence.phi, evidence.trajectories, strict=True)]
    )
    power = np.array([np.sum(t.y**2, axis=0) for t in evidence.trajectories])
    return BaseGram(own, torque, power)


def columns_of(effect: Effect, evidence: Evidence, torques: Sequence[object]) -> Columns:
    """Return the weighed columns of an effect on every trajectory, without the joints that it doesn't touch."""
    raw: dict[int, Array] = {}
    for t, torque in zip(evidence.trajectories, torques, strict=True):
        if id(t.measured) not in raw:
            raw[id(t.measured)] = evidence.structure.columns_of(effect, t.motion, torque)  # type: ignore[arg-type]
    touched = np.any([np.any(columns != 0.0, axis=(0, 2)) for columns in raw.values()], axis=0)
    joints = tuple(int(j) for j in np.flatnonzero(touched))

    def touching(place: int) -> Array:
        return raw[id(evidence.trajectories[place].measured)][:, joints]

    return Columns(effect, joints, weighed_once(evidence.trajectories, touching, joints))


def gram(columns: Columns, evidence: Evidence) -> Gram:
    """Return the Gram matrices of a candidate's columns, by joint [T, n, ...]."""
    n, p = evidence.structure.robot.n, evidence.phi[0].shape[2]
    k = columns.parts[0].shape[2]
    count = len(columns.parts)
    base, own, torque = np.zeros((count, n, p, k)), np.zeros((count, n, k, k)), np.zeros((count, n, k))
    for t, (part, phi, trajectory) in enumerate(zip(columns.parts, evidence.phi, evidence.trajectories, strict=True)):
        for place, joint in enumerate(columns.joints):
            c = part[:, place]
            base[t, joint] = phi[:, joint].T @ c
            own[t, joint] = c.T @ c
            torque[t, joint] = c.T @ trajectory.y[:, joint]
    return Gram(base, own, torque)


@dataclass(frozen=True)
class BaseFit:
    """The base fitted to some of the trajectories: weights [T] of all, inverse of its (scaled) Gram matrix and its
    parameters.
    """

    weights: Array
    inverse: Array
    values: Array

    @classmethod
    def of(cls, base: BaseGram, train: Sequence[int]) -> BaseFit:
        """Fit to the trajectories `train`; the others are left out."""
        weights = np.full(len(base.power), FAINT)
        weights[list(train)] = 1.0
        own, torque, _ = base.weighed(weights)
        inverse = pseudo_inverse(own)
        return cls(weights, inverse, inverse @ torque)

    def loss(self, base: BaseGram, on: int) -> Array:
        """Return the squared error [n] on a trajectory."""
        v = self.values
        return np.asarray(base.power[on] + ((base.own[on] @ v) - 2.0 * base.torque[on]) @ v)


@dataclass(frozen=True)
class Addition:
    """What a candidate adds when fitted to some trajectories: its gain there, its coefficients, and the base beside
    them.
    """

    gain: float
    coefficients: Array
    values: Array


def add(gram_: Gram, fit: BaseFit, ranges: Ranges) -> Addition:
    """Return the gain of a candidate fitted beside the base, no coefficient out of its range."""
    cross, own, torque = gram_.weighed(fit.weights)
    projected = own - cross.T @ fit.inverse @ cross
    right = torque - cross.T @ fit.values
    coefficients = within_ranges(projected, right, np.diag(own), ranges)
    gain = float(2.0 * coefficients @ right - coefficients @ projected @ coefficients)
    return Addition(gain, coefficients, fit.values - fit.inverse @ (cross @ coefficients))


def loss_with(gram_: Gram, base: BaseGram, addition: Addition, on: int) -> Array:
    """Return the squared error [n] on a trajectory of base and candidate."""
    v, c = addition.values, addition.coefficients
    plain = base.power[on] + ((base.own[on] @ v) - 2.0 * base.torque[on]) @ v
    return np.asarray(plain + (2.0 * (v @ gram_.base[on]) - 2.0 * gram_.torque[on] + gram_.own[on] @ c) @ c)


def within_ranges(projected: Array, right: Array, size: Array, ranges: Ranges) -> Array:
    """Solve the small normal equations; columns that the base holds already get zero, and those that would need what
    no robot has are left out, by trying subsets.
    """
    k = len(right)
    alive = [i for i in range(k) if projected[i, i] > HELD * size[i]]
    if k == 1:
        only = right[0] / projected[0, 0] if alive else 0.0
        return np.array([only if ranges[0][0] <= only <= ranges[0][1] else 0.0])
    best, best_gain = np.zeros(k), 0.0
    for count in range(len(alive), 0, -1):
        for chosen in combinations(alive, count):
            rows = list(chosen)
            block = projected[np.ix_(rows, rows)]
            scale = np.sqrt(block.diagonal())
            solution = least_solution(block / scale / scale[:, None], right[rows] / scale) / scale
            if any(not ranges[i][0] <= value <= ranges[i][1] for i, value in zip(rows, solution, strict=True)):
                continue
            gain = float(solution @ right[rows])
            if gain > best_gain:
                best_gain, best = gain, np.zeros(k)
                best[rows] = solution
        if best_gain > 0.0:
            break
    return best


@dataclass(frozen=True)
class Folds:
    """The base fitted to all trajectories and to all but one; loss [T, n]: its squared error on each one left out."""

    base: BaseGram
    whole: BaseFit
    without: tuple[BaseFit, ...]
    loss: Array

    @classmethod
    def of(cls, base: BaseGram) -> Folds:
        """Fit the base."""
        count = len(base.power)
        everything = range(count)
        if count < 2:
            return cls(base, BaseFit.of(base, everything), (), np.zeros((0, base.power.shape[1])))
        without = tuple(BaseFit.of(base, [t for t in everything if t != left]) for left in everything)
        loss = np.array([fit.loss(base, left) for left, fit in enumerate(without)])
        return cls(base, BaseFit.of(base, everything), without, loss)
