"""A set of selected effects beside the base, fitted to all recordings and to all but each; what a further one gains.

All of it follows from inner products by joint and fold. With base and selected effects E, a further column x leaves A =
x'x - x'E (E'E)^-1 E'x of itself and gains r^2 / A, r = x'(y - E v) (Frisch and Waugh 1933).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_ident.diagnosis.selection.data_set import DataSet
from robot_ident.diagnosis.selection.hypotheses import TIMING, Hypothesis
from robot_ident.regression.gram import HELD, within_ranges
from robot_ident.regression.normal_equations import least_gains, pseudo_inverse
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Fit:
    """One fit: weights [F] of the folds, the folds that it predicts, the inverse normal matrix [q, q], parameters [q],
    and for the folds that it predicts the inner products E'(y - E v) [n, q].
    """

    weights: Array
    predicts: list[int]
    inverse: Array
    values: Array
    rest: dict[int, Array]


@dataclass(frozen=True)
class _InPool:
    """A joint's pool beside one fit: E'x [q, P], (E'E)^-1 E'x [q, P], x'x [P, P], x'(y - E v) [P] of the fitted rows,
    and of the predicted folds.
    """

    cross: Array
    projected: Array
    own: Array
    right: Array
    predicted: dict[int, Array]


@dataclass(frozen=True)
class Addition:
    """One hypothesis or several beside one fit: normal matrix after projection, squares, right side, (E'E)^-1 E'x."""

    square: Array
    size: Array
    right: Array
    projected: Array


class FittedSet:
    """Base and selected effects, fitted; loss [F, n]: squared error of every fold by the fit that predicts it.

    dispersion [F, n]: by which the squared errors of a joint are divided: what it lacks weighs its rows down.
    """

    def __init__(self, data: DataSet, selected: Sequence[Hypothesis], dispersion: Array) -> None:
        """Fit all folds and all but each."""
        self.data, self.selected, self.dispersion = data, tuple(selected), dispersion
        ends = np.cumsum([data.p, *(len(h.ranges) for h in selected)])
        self.spans = [np.arange(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]
        self.q = int(ends[-1])
        self.own, self.torque = self._inner_products()
        self.loss = np.zeros_like(data.power)
        self.fits = self._fits()
        self._pools: dict[tuple[int, int], tuple[Array, list[_InPool]]] = {}
        self._blocks: list[Array] | None = None
        self._added: dict[tuple[int, tuple[Hypothesis, ...]], tuple[Array, Addition]] = {}

    def _inner_products(self) -> tuple[Array, Array]:
        """Return E'E [F, n, q, q] and E'y [F, n, q]."""
        data, p = self.data, self.data.p
        own = np.zeros((*data.power.shape, self.q, self.q))
        torque = np.zeros((*data.power.shape, self.q))
        own[:, :, :p, :p], torque[:, :, :p] = data.base_own, data.base_torque
        for mine, span in zip(self.selected, self.spans, strict=True):
            for j, at in mine.at.items():
                pool = data.pools[j]
                cross = pool.cross[:, :, at]
                own[:, j, :p, span[0] : span[-1] + 1] = cross
                own[:, j, span[0] : span[-1] + 1, :p] = cross.swapaxes(1, 2)
                torque[:, j, span] = pool.torque[:, at]
                for other, beside in zip(self.selected, self.spans, strict=True):
                    if j in other.at:
                        block = pool.own[:, at[:, None], other.at[j]]
                        own[:, j, span[0] : span[-1] + 1, beside[0] : beside[-1] + 1] = block
        return own, torque

    def _fits(self) -> list[Fit]:
        data = self.data
        ranges = [(-np.inf, np.inf)] * data.p + [r for h in self.selected for r in h.ranges]
        scaled = 1.0 / self.dispersion
        own, torque = np.einsum("fjpq,fj->fpq", self.own, scaled), np.einsum("fjp,fj->fp", self.torque, scaled)
        out = []
        for weights, predicts in data.left_out_weights():
            square, right = np.tensordot(weights, own, 1), weights @ torque
            kept = np.arange(self.q)
            while True:
                whole = np.zeros_like(square)
                whole[np.ix_(kept, kept)] = pseudo_inverse(square[np.ix_(kept, kept)])
                values = whole @ right
                outside = [k for k in kept if not ranges[k][0] <= values[k] <= ranges[k][1]]
                if not outside:
                    break
                kept = np.setdiff1d(kept, outside)
            rest = {}
            for f in predicts:
                rest[f] = self.torque[f] - self.own[f] @ values
                self.loss[f] = (
                    data.power[f] - 2.0 * self.torque[f] @ values + np.einsum("q,jqr,r->j", values, self.own[f], values)
                )
            out.append(Fit(weights, predicts, whole, values, rest))
        return out

    @property
    def whole(self) -> Fit:
        """The fit to all training folds."""
        return self.fits[-1]

    def excess(self) -> Array:
        """Return by how much the squared error [n] exceeds noise in the fit to all training folds, in the rows that no
        unresolved motion at reversals spoils and in which the joint does not creep.
        """
        data, out, spent = self.data, np.zeros(self.data.n), self.parameters_of()
        used = np.array([np.sum(t.weight > 0.0, axis=0) for t in data.folds[: data.training]])
        for f, j in np.ndindex(used.shape):
            kept = data.kept(f, j) & data.moving[f][:, j]
            error, count = self._error(j, f, self.whole.values)[kept], kept.sum()
            out[j] += float(error @ error) - data.dof[f, j] * count / max(used[f, j], 1)
            out[j] += spent[j] * count / max(used[:, j].sum(), 1)
        return out

    def largest_excess(self) -> Array:
        """Return by how much the squared error [n] of all folds, not fitted, may exceed noise: by one standard
        deviation of noise more than it does.
        """
        noise = self.data.floor * self.data.dof.sum(axis=0)
        return np.asarray(self.loss.sum(axis=0) - noise + np.sqrt(2.0 * noise))

    def fall_where_resolved(self, new: Hypothesis, joint: int) -> tuple[float, float]:
        """Return the fall of a joint's squared error on motion that was not fitted with a further hypothesis, and by
        how much it exceeds noise without, in the rows that no unresolved motion at reversals spoils.
        """
        data, fall, excess = self.data, 0.0, 0.0
        for number, fit in enumerate(self.fits):
            errors = self._refitted(number, new)
            for f in (f for f in fit.predicts if f < data.training):
                kept = data.kept(f, joint)
                before, after = (error[kept] for error in errors(joint, f))
                used = max(int(np.sum(data.folds[f].weight[:, joint] > 0.0)), 1)
                excess += float(before @ before) - data.floor * data.dof[f, joint] * kept.sum() / used
                fall += float(before @ before) - float(after @ after)
        return fall, excess

    @cached_property
    def fitted_dispersion(self) -> Array:
        """Squared error [n] of the training folds in the fit to all of them, over the degrees of freedom it leaves."""
        some, values = slice(0, self.data.training), self.whole.values
        left = self.data.power[some] - 2.0 * self.torque[some] @ values + (self.own[some] @ values) @ values
        free = np.maximum(self.data.dof[some].sum(axis=0) - self.parameters_of(), 1.0)
        return np.asarray(np.maximum(left.sum(axis=0), 1e-300) / free)

    def parameters_of(self) -> Array:
        """Return the number of parameters [n] that the fit to all training folds spends on each joint."""
        used = self.own[: self.data.training] / self.dispersion[: self.data.training, :, None, None]
        return np.asarray(np.einsum("pq,fjqp->j", self.whole.inverse, used))

    def _pool(self, joint: int) -> tuple[Array, list[_InPool]]:
        """Return E'x [F, q, P] of a joint's pool, and the pool beside every fit; computed again as the pool grows."""
        data = self.data
        pool = data.pools[joint]
        key = (joint, pool.count)
        if key in self._pools:
            return self._pools[key]
        cross = np.zeros((len(data.folds), self.q, pool.count))
        cross[:, : data.p] = pool.cross
        for mine, span in zip(self.selected, self.spans, strict=True):
            if joint in mine.at:
                cross[:, span] = pool.own[:, mine.at[joint]]
        beside = []
        of_all = self.whole.weights / self.dispersion[:, joint]
        all_mixed, all_own = np.tensordot(of_all, cross, 1), np.tensordot(of_all, pool.own, 1)
        for fit in self.fits:
            weights = fit.weights / self.dispersion[:, joint]
            mixed, own = all_mixed, all_own
            for f in np.flatnonzero(weights != of_all):
                less = of_all[f] - weights[f]
                mixed, own = mixed - less * cross[f], own - less * pool.own[f]
            right = weights @ pool.torque - mixed.T @ fit.values
            predicted = {f: pool.torque[f] - cross[f].T @ fit.values for f in fit.predicts}
            beside.append(_InPool(mixed, fit.inverse @ mixed, own, right, predicted))
        self._pools = {k: v for k, v in self._pools.items() if k[0] != joint}
        self._pools[key] = (cross, beside)
        return self._pools[key]

    def addition(self, number: int, *new: Hypothesis) -> Addition:
        """Return what further hypotheses are beside the fit of a number."""
        if len(new) == len(new[0].at) == 1:  # no sums to make
            ((joint, at),) = new[0].at.items()
            seen = self._pool(joint)[1][number]
            square, projected = seen.own[at[:, None], at], seen.projected[:, at]
            return Addition(square - seen.cross[:, at].T @ projected, square.diagonal(), seen.right[at], projected)
        spans = _spans(new)
        count = sum(len(span) for span in spans)
        square, right = np.zeros((count, count)), np.zeros(count)
        cross, projected = np.zeros((self.q, count)), np.zeros((self.q, count))
        for h, span in zip(new, spans, strict=True):
            for j, at in h.at.items():
                seen = self._pool(j)[1][number]
                right[span] += seen.right[at]
                cross[:, span] += seen.cross[:, at]
                projected[:, span] += seen.projected[:, at]
                for other, beside in zip(new, spans, strict=True):
                    if j in other.at:
                        square[span[:, None], beside] += seen.own[at[:, None], other.at[j]]
        size = np.diag(square).copy()
        return Addition(square - cross.T @ projected, size, right, projected)

    def coefficients(self, number: int, *new: Hypothesis) -> tuple[Array, Addition]:
        """Return the linear parameters of further hypotheses beside the fit of a number."""
        key = number % len(self.fits), new
        if key not in self._added:
            made = self.addition(number, *new)
            ranges = [r for h in new for r in h.ranges]
            self._added[key] = within_ranges(made.square, made.right, made.size, ranges), made
        return self._added[key]

    def gain(self, *new: Hypothesis) -> float:
        """Return the fall of the squared error of all training folds, refitted (score test)."""
        c, made = self.coefficients(-1, *new)
        return float(2.0 * c @ made.right - c @ made.square @ c)

    def held_out_gain(self, *new: Hypothesis) -> Array:
        """Return the fall of the squared error [F, n] of folds that were not fitted."""
        data = self.data
        out, spans = np.zeros_like(data.power), _spans(new)
        for number, fit in enumerate(self.fits):
            if not fit.predicts:
                continue
            c, made = self.coefficients(number, *new)
            if not np.any(c):
                continue
            u = made.projected @ c
            for f in fit.predicts:
                fall = -2.0 * fit.rest[f] @ u - (self.own[f] @ u) @ u
                for h, span in zip(new, spans, strict=True):
                    for j, at in h.at.items():
                        cross, beside = self._pool(j)
                        fall[j] += (
                            2.0 * beside[number].predicted[f][at] @ c[span] + 2.0 * (u @ cross[f][:, at]) @ c[span]
                        )
                        for other, span2 in zip(new, spans, strict=True):
                            if j in other.at:
                                block = data.pools[j].own[f][at[:, None], other.at[j]]
                                fall[j] -= c[span] @ block @ c[span2]
                out[f] = fall
        return out

    def block_losses(self, *new: Hypothesis) -> list[Array]:
        """Return the squared error [blocks, n] of every fold's blocks, not fitted, without and with a hypothesis."""
        if not new and self._blocks is not None:
            return self._blocks
        data = self.data
        out: list[Array] = [np.zeros((0, data.n))] * len(data.folds)
        for number, fit in enumerate(self.fits):
            if not fit.predicts:
                continue
            values, spans, c = fit.values, _spans(new), np.zeros(0)
            if new:
                c, made = self.coefficients(number, *new)
                values = values - made.projected @ c
            for f in fit.predicts:
                losses = []
                for j in range(data.n):
                    error = self._error(j, f, values)
                    for h, span in zip(new, spans, strict=True):
                        if j in h.at:
                            error = error - data.pools[j].rows(f, h.at[j]) @ c[span]
                    losses.append(np.asarray(np.bincount(data.blocks[f], error**2), dtype=float))
                out[f] = np.array(losses).T
        if not new:
            self._blocks = out
        return out

    def noise_losses(self, products: Callable[[int, int], Array]) -> Array:
        """Return by what the squared error [R] of folds that were not fitted, over its dispersion, changes with noise
        of those that were, less its mean; products: of joint and fold, E'e [R, q] with the noise e of each draw.

        Noise moves the parameters by (E'E)^-1 E'e, and what a fold left out loses for all its rows alike.
        """
        data, weight = self.data, 1.0 / self.dispersion
        made = [sum(np.sqrt(weight[f, j]) * products(j, f) for j in range(data.n)) for f in range(data.training)]
        out = np.zeros(len(made[0]))
        for fit in self.fits:
            others = [made[f] for f in range(data.training) if f not in fit.predicts]
            moved = sum(others, start=np.zeros_like(made[0])) @ fit.inverse
            for f in fit.predicts:
                own, rest = np.tensordot(weight[f], self.own[f], 1), weight[f] @ fit.rest[f]
                change = np.einsum("rp,rp->r", moved @ own, moved)
                out += change - change.mean() - 2.0 * moved @ rest
        return out

    def size_error(self, new: Hypothesis) -> float:
        """Return the relative standard error of a further hypothesis's size: with its torque u and what is left with it
        e on motion that was not fitted, sqrt(sum_b (e'u)_b^2) / |sum_b (r'u)_b|, r = e + u, over blocks b within which
        errors may depend on each other (the sandwich of Liang and Zeger 1986). How late an effort is, is judged where
        the motion is resolved: at reversals that it does not resolve, a kink looks late.
        """
        data, size, spread = self.data, 0.0, 0.0
        for number, fit in enumerate(self.fits):
            errors = self._refitted(number, new)
            for f in fit.predicts:
                together = np.zeros(int(data.blocks[f][-1]) + 1)
                for j in range(data.n):
                    before, after = errors(j, f)
                    torque, weight = before - after, 1.0 / self.dispersion[f, j]
                    torque = np.where(data.kept(f, j), torque, 0.0) if new.effect.name in TIMING else torque
                    size += weight * float(before @ torque)
                    together += weight * np.bincount(data.blocks[f], after * torque)
                spread += float(together @ together)
        return float(np.sqrt(spread)) / size if size > 0.0 else np.inf

    def colours(self, new: Hypothesis) -> tuple[Array, Array]:
        """Return what `_colours` tells of a further hypothesis."""
        return _colours(self.data, self.dispersion[0], self._refitted(-1, new))

    def colours_beside(self, other: FittedSet) -> tuple[Array, Array]:
        """Return what `_colours` tells of the difference between this set and another one, fitted after it."""
        return _colours(self.data, self.dispersion[0], lambda j, f: (self.residual(j, f), other.residual(j, f)))

    def columns(self, joint: int, fold: int) -> Array:
        """Return base and selected effects in a joint's rows of a fold, whitened [N, q]."""
        out = np.zeros((len(self.data.y[joint][fold]), self.q))
        out[:, : self.data.p] = self.data.base[joint][fold]
        for h, span in zip(self.selected, self.spans, strict=True):
            if joint in h.at:
                out[:, span] = self.data.pools[joint].rows(fold, h.at[joint])
        return out

    def residual(self, joint: int, fold: int) -> Array:
        """Return what the fit to all training folds leaves of a joint in a fold, whitened [N]."""
        return self._error(joint, fold, self.whole.values)

    def _error(self, joint: int, fold: int, values: Array) -> Array:
        """Return a joint's whitened error [N] in a fold with some parameters."""
        data = self.data
        error = data.y[joint][fold] - data.base[joint][fold] @ values[: data.p]
        for h, span in zip(self.selected, self.spans, strict=True):
            if joint in h.at:
                error = error - data.pools[joint].rows(fold, h.at[joint]) @ values[span]
        return np.asarray(error)

    def _refitted(self, number: int, new: Hypothesis) -> Callable[[int, int], tuple[Array, Array]]:
        """Return a function of joint and fold: the errors [N] of the fit of a number, without and with a hypothesis."""
        c, made = self.coefficients(number, new)
        values = self.fits[number].values
        refitted = values - made.projected @ c

        def errors(joint: int, fold: int) -> tuple[Array, Array]:
            after = self._error(joint, fold, refitted)
            own = self.data.pools[joint].rows(fold, new.at[joint]) @ c if joint in new.at else 0.0
            return self._error(joint, fold, values), after - own

        return errors

    def contribution(self, mine: Hypothesis) -> Array:
        """Return the squared torque [n] of a selected effect in the training folds, beside the base alone."""
        data = self.data
        c = self.whole.values[self.spans[self.selected.index(mine)]]
        weights = np.zeros((len(data.folds), 1))
        weights[: data.training] = 1.0
        by_joint = weights / self.dispersion
        square = pseudo_inverse(np.einsum("fj,fjpq->pq", by_joint, data.base_own))
        cross = sum(np.einsum("f,fpk->pk", by_joint[:, j], data.pools[j].cross[:, :, at]) for j, at in mine.at.items())
        taken = square @ (cross @ c)
        out = np.einsum("p,fjpq,q->j", taken, data.base_own[: data.training], taken)
        for j, at in mine.at.items():
            pool = data.pools[j]
            for f in range(data.training):
                out[j] += c @ pool.own[f][at[:, None], at] @ c - 2.0 * taken @ pool.cross[f][:, at] @ c
        return np.asarray(out)

    def most_gains(self, joint: int, at: Array) -> Array:
        """Return the most [H] that hypotheses of a joint alone at places [H, k] of its pool gain, whatever the ranges
        of their parameters.
        """
        seen = self._pool(joint)[1][-1]
        square = seen.own[at[:, :, None], at[:, None, :]]
        square = square - np.einsum("qha,qhb->hab", seen.cross[:, at], seen.projected[:, at], optimize=True)
        own = np.einsum("haa->ha", square)
        free = own > HELD * np.einsum("haa->ha", seen.own[at[:, :, None], at[:, None, :]])
        scale = np.where(free, 1.0 / np.sqrt(np.where(free, own, 1.0)), 0.0)
        right = seen.right[at] * scale
        return least_gains(square * scale[:, :, None] * scale[:, None, :], right)

    def single_gains(self, joint: int) -> tuple[Array, Array]:
        """Return coefficient and right side [P] of every column of a joint's pool alone, whatever its range."""
        seen = self._pool(joint)[1][-1]
        own = np.diag(seen.own)
        square = own - np.einsum("qP,qP->P", seen.cross, seen.projected)
        free = square > HELD * own
        return np.where(free, seen.right / np.where(free, square, 1.0), 0.0), seen.right

    def pair_matrix(self, joint: int) -> tuple[Array, Array, Array]:
        """Return A [P, P], r [P] and x'x [P] of a joint's whole pool beside the fit to all folds."""
        seen = self._pool(joint)[1][-1]
        return seen.own - seen.cross.T @ seen.projected, seen.right, np.diag(seen.own)


def standard_errors(falls: Array) -> float:
    """Return the mean fall of the squared error in blocks [B] over its standard error."""
    spread = float(falls.std(ddof=1)) * np.sqrt(len(falls))
    return float(falls.sum()) / spread if spread > 0.0 else 0.0


def _spans(new: Sequence[Hypothesis]) -> list[Array]:
    ends = np.cumsum([0, *(len(h.ranges) for h in new)])
    return [np.arange(*pair) for pair in zip(ends[:-1], ends[1:], strict=True)]


def _colours(
    data: DataSet, dispersion: Array, errors: Callable[[int, int], tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Return how many times more the torque u by which one fit differs from another gains by chance than of white
    noise, were what a fit to all training folds leaves e noise of its own spectrum: sum_jk S_u S_e / sum_j sum_k S_u
    sum_k S_e / n_j, 1 at least, over the lines k of both spectra, n_j independent rows. [2]: with e before and after;
    and its squared error [2, n] then. errors: of a joint in a fold, before and after [N].

    What is missing has the motion's lines, as effects of the motion have; these then explain much of it by chance.
    """
    both, apart = np.zeros(2), np.zeros(2)
    squares = np.zeros((2, data.n))
    for j in range(data.n):
        pairs = [np.concatenate([errors(j, f) for f in folds], axis=1) for folds in data.of_measurement]
        squares[:, j] = np.sum([np.sum(np.square(pair), axis=1) for pair in pairs], axis=0)
        series = [np.stack([before, after, before - after]) for before, after in pairs]
        mean = np.concatenate(series, axis=1).mean(axis=1, keepdims=True)  # has no phase that may be by chance
        for folds, one in zip(data.of_measurement, series, strict=True):
            *e, u = np.abs(np.fft.fft(one - mean)) ** 2 / dispersion[j]
            both += e @ u
            apart += np.sum(e, axis=1) * u.sum() / max(float(data.dof[folds, j].sum()), 1.0)
    return np.maximum(1.0, both / np.where(apart > 0.0, apart, np.inf)), squares
