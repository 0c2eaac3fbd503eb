"""Nonlinear parameters of a hypothesis between the points of their grid, by variable projection (Golub, Pereyra 1973).

They stay within the hull of the values that were looked at, plus half a step: an end stop that wanders to mid-range is
a cable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.diagnosis.selection.data_set import DataSet, Rows
from robot_ident.diagnosis.selection.fitted_set import FittedSet
from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.diagnosis.selection.read_off import add_lines
from robot_ident.effects import Effect, Inner
from robot_ident.effects.torque_ripple import TorqueRipple
from robot_ident.regression.evidence import Evidence
from robot_ident.regression.gram import within_ranges
from robot_ident.signals.motion import Array, joined

_FINE = 0.05  # of a step of the grid: how near the best value is looked for
_ONE, _SEVERAL = 12, 35  # evaluations of one parameter, of several
_NEARLY = 0.8  # of what the best kind of an effect gains on the grid
_BETTER = 0.5  # chi-square units that a refined value must gain


@dataclass(frozen=True)
class _Axis:
    """A stretch of a nonlinear parameter: from its value to the next point of the grid on either side."""

    inner: Inner
    middle: float
    low: float
    high: float

    def value(self, x: float) -> float:
        """Return the parameter at x in -1..1."""
        reach = self.high - self.middle if x > 0 else self.middle - self.low
        return self.inner.unscaled(self.middle + reach * float(np.clip(x, -1.0, 1.0)))


def _axis(inner: Inner, effect: Effect, looked_at: Sequence[float]) -> _Axis:
    """Lay a stretch about an effect's own value, at most half a step beyond the values that were looked at."""
    middle = inner.scaled(effect.setting[inner.name])
    points = np.unique([inner.scaled(value) for value in looked_at])
    if len(points) < 2:
        reach = 0.1 * max(abs(middle), 1e-3)
        return _Axis(inner, middle, middle - reach, middle + reach)
    bottom, top = points[0] - 0.5 * (points[1] - points[0]), points[-1] + 0.5 * (points[-1] - points[-2])
    apart = np.abs(points - middle)
    reach = float(apart[apart > 1e-3 * np.ptp(points)].min())
    return _Axis(inner, middle, max(middle - reach, min(bottom, middle)), min(middle + reach, max(top, middle)))


class Refinement:
    """Refines hypotheses of a data set; what it found is kept by hypothesis and set."""

    def __init__(self, data: DataSet) -> None:
        """Begin with nothing found."""
        self.data = data
        self._found: dict[object, Hypothesis] = {}

    def of(self, given: FittedSet, mine: Hypothesis) -> Hypothesis:
        """Return a hypothesis at the best values near its own, beside a set; itself where none gains more.

        Other kinds of the same effect that gain nearly as much on the grid are refined as well.
        """
        if not self._axes(mine):
            return mine
        key = (id(mine), tuple(sorted(id(h) for h in given.selected)), given.dispersion.tobytes())
        if key not in self._found:
            kinds = [mine, *self._other_kinds(given, mine)]
            self._found[key] = max((self._refined(given, h, self._axes(h)) for h in kinds), key=given.gain)
        return self._found[key]

    def _other_kinds(self, given: FittedSet, mine: Hypothesis) -> list[Hypothesis]:
        """Return the best value on the grid of every other kind of an effect that gains nearly as much."""
        names = [inner.name for inner in mine.effect.inner if not inner.continuous]
        best: dict[tuple[float, ...], Hypothesis] = {}
        for h in self.data.hypotheses[mine.label][: self.data.grid.get(mine.label, 0)] if names else ():
            kind = tuple(h.effect.setting[name] for name in names)
            if kind not in best or given.gain(h) > given.gain(best[kind]):
                best[kind] = h
        best.pop(tuple(mine.effect.setting[name] for name in names), None)
        return [h for h in best.values() if given.gain(h) > _NEARLY * given.gain(mine)]

    def _axes(self, mine: Hypothesis) -> list[_Axis]:
        effect = mine.effect
        kinds = [inner.name for inner in effect.inner if not inner.continuous]
        known = self.data.hypotheses[mine.label][: self.data.grid.get(mine.label, 0)]
        alike = [h.effect.setting for h in known if all(h.effect.setting.get(k) == effect.setting[k] for k in kinds)]
        if isinstance(effect, TorqueRipple):
            ((inner,), order) = effect.inner, effect.setting["h"]
            near = effect.resolution(joined([t.motion for t in self.data.folds[: self.data.training]]))
            return [_Axis(inner, order, order - near, order + near)] if near else []
        return [
            _axis(inner, effect, [s[inner.name] for s in alike if inner.name in s])
            for inner in effect.inner
            if inner.continuous
        ]

    def _refined(self, given: FittedSet, mine: Hypothesis, axes: Sequence[_Axis]) -> Hypothesis:
        from scipy.optimize import minimize, minimize_scalar

        rows = _Beside(given, mine)

        def at(x: Array) -> Effect:
            return mine.effect.at({a.inner.name: a.value(float(v)) for a, v in zip(axes, x, strict=True)})

        def loss(x: Array | float) -> float:
            return -rows.gain(at(np.atleast_1d(np.asarray(x, dtype=float))))

        if len(axes) == 1:
            found = minimize_scalar(
                loss, bounds=(-1.0, 1.0), method="bounded", options={"xatol": _FINE, "maxiter": _ONE}
            )
            best = np.array([found.x])
        else:
            start = np.zeros(len(axes))
            options = {
                "maxfev": _SEVERAL,
                "xatol": _FINE,
                "fatol": _BETTER,
                "initial_simplex": np.vstack([start, 0.5 * np.eye(len(axes))]),
            }
            found = minimize(loss, start, method="Nelder-Mead", bounds=[(-1.0, 1.0)] * len(axes), options=options)
            best = np.asarray(found.x)
        if -float(found.fun) <= given.gain(mine) + _BETTER:
            return mine
        return self.data.add(at(best)) or mine


def best_values(effect: Effect, evidence: Evidence) -> tuple[Effect, float] | None:
    """Return an effect at the values of its nonlinear parameters that gain most beside a model, and that gain in units
    of chi-square; None where these recordings do not show it.
    """
    data = DataSet(Rows.plain(evidence), [effect])
    given = FittedSet(data, (), np.ones_like(data.power))
    if isinstance(effect, TorqueRipple):
        add_lines(given, [effect])
    settings = data.hypotheses.get(effect.label)
    if not settings:
        return None
    best = Refinement(data).of(given, max(settings, key=given.gain))
    return best.effect, given.gain(best)


class _Beside:
    """Base and selected effects as rows, so that an effect that is in no pool yet is judged beside them."""

    def __init__(self, given: FittedSet, mine: Hypothesis) -> None:
        self.given, self.joints = given, mine.joints
        data, v = given.data, given.whole.values
        self.rows: dict[tuple[int, int], Array] = {}
        self.rest: dict[tuple[int, int], Array] = {}
        for j in self.joints:
            for f in range(data.training):
                rows = np.zeros((len(data.y[j][f]), given.q))
                rows[:, : data.p] = data.base[j][f]
                for h, span in zip(given.selected, given.spans, strict=True):
                    if j in h.at:
                        rows[:, span] = data.pools[j].rows(f, h.at[j])
                self.rows[j, f] = rows
                self.rest[j, f] = data.y[j][f] - rows @ v

    def gain(self, effect: Effect) -> float:
        """Return the fall of the squared error of all training folds with an effect."""
        given, columns = self.given, self.given.data.columns(effect)
        k = len(effect.ranges)
        cross, own, right = np.zeros((given.q, k)), np.zeros((k, k)), np.zeros(k)
        for j in set(columns) & set(self.joints):
            for f in range(given.data.training):
                x, scale = columns[j][f], 1.0 / given.dispersion[f, j]
                cross += scale * (self.rows[j, f].T @ x)
                own += scale * (x.T @ x)
                right += scale * (x.T @ self.rest[j, f])
        square = own - cross.T @ given.whole.inverse @ cross
        c = within_ranges(square, right, np.diag(own), effect.ranges)
        return float(2.0 * c @ right - c @ square @ c)
