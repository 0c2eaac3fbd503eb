"""Inner parameters between the points of their grid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.candidates import Candidate, Folds, Score, score_grams
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.scan import add, columns_of, gram
from robot_ident.effects import Effect, Inner
from robot_ident.signals.motion import Array

_NEAR = 0.6  # of the best held-out gain from which on a rival is refined, too
_CONTENDERS = 4  # at most, the best among them
_ROUNDS = 3  # of search, each from where the one before came to the end of its range
_EDGE = 0.9  # of the range, from which on the best may lie beyond it
_FINE = 0.02  # of the range: how near the best place is looked for


def refined(found: Score, evidence: Evidence, folds: Folds) -> Score:
    """Return the score with its continuous inner parameters at the best place between the grid's points.

    Variable projection: the linear parameters follow in each step, all of the data together.
    """
    best = found
    for _ in range(_ROUNDS):
        axes = [_Axis.of(inner, best.effect) for inner in best.effect.inner if inner.continuous]
        if not axes:
            return best
        x = _search(best.effect, axes, evidence, folds)
        effect = _at(best.effect, axes, x)
        columns = columns_of(effect, evidence, _torques(evidence))
        better = score_grams(Candidate(found.label, (columns,)), [gram(columns, evidence)], folds)
        if better.gain <= best.gain:
            return best
        best = better
        if np.max(np.abs(x)) < _EDGE:
            return best
    return best


@dataclass(frozen=True)
class _Axis:
    """A stretch of an inner parameter: from its value to the next point of the grid on either side."""

    inner: Inner
    value: float
    reach: float

    @classmethod
    def of(cls, inner: Inner, effect: Effect) -> _Axis:
        """Lay it about an effect's own value."""
        value, points = inner.scaled(effect.setting[inner.name]), np.array([inner.scaled(p) for p in inner.grid])
        apart = np.abs(points - value)
        apart = apart[apart > 1e-3 * np.ptp(points)]
        return cls(inner, value, float(apart.min()) if len(apart) else 0.1 * max(abs(value), 1e-3))

    def at(self, x: float) -> float:
        """Return the parameter at x in -1..1 of the stretch, within its bounds."""
        return self.inner.unscaled(self.value + self.reach * x)


def _at(effect: Effect, axes: Sequence[_Axis], x: Array) -> Effect:
    return effect.at({axis.inner.name: axis.at(float(place)) for axis, place in zip(axes, x, strict=True)})


def _torques(evidence: Evidence) -> list[object]:
    return [evidence.structure.torques(t.motion, evidence.values) for t in evidence.trajectories]


def _search(effect: Effect, axes: Sequence[_Axis], evidence: Evidence, folds: Folds) -> Array:
    """Return the place [axes] in -1..1 of each stretch where the gain is largest."""
    from scipy.optimize import minimize, minimize_scalar

    torques = _torques(evidence)

    def loss(x: Array) -> float:
        moved = _at(effect, axes, np.atleast_1d(x))
        columns = columns_of(moved, evidence, torques)
        return -add(gram(columns, evidence), folds.whole, moved.ranges).gain if columns.joints else 0.0

    if len(axes) == 1:
        found = minimize_scalar(loss, bounds=(-1.0, 1.0), method="bounded", options={"xatol": _FINE, "maxiter": 20})
        return np.array([found.x])
    start = np.zeros(len(axes))
    simplex = np.vstack([start, 0.5 * np.eye(len(axes))])
    options = {"maxfev": 60, "xatol": _FINE, "fatol": 0.1, "initial_simplex": simplex}
    return np.asarray(minimize(loss, start, method="Nelder-Mead", bounds=[(-1.0, 1.0)] * len(axes), options=options).x)


def sharpened(best: Score, scores: Sequence[Score], evidence: Evidence, folds: Folds) -> list[Score]:
    """Return the scores, best first, with the best and the rivals that come near it refined.

    Between the points of a coarse grid a cause may lose to a proxy that happens to lie on a point of its own.
    """
    joints = set(best.columns.joints)
    near = [s for s in scores if s.held_out >= _NEAR * best.held_out and joints & set(s.columns.joints)][:_CONTENDERS]
    sharp = {s.label: refined(s, evidence, folds) for s in near}
    return sorted((sharp.get(s.label, s) for s in scores), key=lambda s: -s.held_out)
