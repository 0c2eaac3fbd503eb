"""Column generation: the best distribution over states, and what its dual proves.

Between two searches for further states the determinant is maximised over the weights of those found.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from robot_ident.design.bound.moments import Moments
from robot_ident.design.bound.oracle import Oracle, Prices
from robot_ident.signals.motion import Array, Motion, joined

_CENTRING = 0.1  # by which the complementarity is asked to fall in a step
_ITERATIONS = 150


@dataclass(frozen=True)
class Weights:
    """Weights [K] of the atoms, their information M [p, p], and multipliers of equalities, inequalities and total.

    gap: log det of the optimum over these atoms less that of M is at most this.
    """

    xi: Array
    information: Array
    equal: Array
    unequal: Array
    total: float
    gap: float


def maximise_log_det(rows: Array, equalities: Array, inequalities: Array, prior: Array, gap: float = 1e-4) -> Weights:
    """Return the weights xi >= 0, sum xi = 1 that maximise log det(M0 + sum_k xi_k B_k' B_k).

    Subject to sum_k xi_k g_k = 0 and sum_k xi_k h_k <= 0. rows B [K, n, p], equalities g [K, m], inequalities h [K, J],
    prior M0 [p, p]. A primal-dual interior-point method (Boyd and Vandenberghe 2004, section 11.7) with weights and
    slacks as its positive variables; the Newton matrix is reduced to one of the size p (p + 1) / 2 + m + J + 1.
    """
    problem = _Problem(rows, equalities, inequalities, prior)
    x, y, z = problem.start()
    for _ in range(_ITERATIONS):
        surrogate = float(x @ z)
        residual = problem.residual(x, y, z, 0.0)
        if surrogate < gap and np.linalg.norm(residual[: -len(x)]) < 1e-3 * gap:
            break
        target = _CENTRING * surrogate / len(x)
        dx, dy, dz = problem.step(x, y, z, target)
        length = min(1.0, 0.99 * _room(x, dx), 0.99 * _room(z, dz))
        before = np.linalg.norm(problem.residual(x, y, z, target))
        while length > 1e-10:
            after = problem.residual(x + length * dx, y + length * dy, z + length * dz, target)
            if np.linalg.norm(after) <= (1.0 - 0.01 * length) * before:
                break
            length *= 0.5
        else:
            break  # rounding is reached
        x, y, z = x + length * dx, y + length * dy, z + length * dz
    return problem.solution(x, y, z)


def _room(x: Array, dx: Array) -> float:
    """Return the longest step that leaves x + step dx positive."""
    falling = dx < 0.0
    return float(np.min(-x[falling] / dx[falling])) if falling.any() else np.inf


class _Problem:
    def __init__(self, rows: Array, equalities: Array, inequalities: Array, prior: Array) -> None:
        self.rows, self.prior = rows, prior
        self.count, slacks = len(rows), inequalities.shape[1]
        self.m = equalities.shape[1]
        self.matrix = np.zeros((self.m + slacks + 1, self.count + slacks))  # E x = e
        self.matrix[: self.m, : self.count] = equalities.T
        self.matrix[self.m : -1, : self.count] = inequalities.T
        self.matrix[self.m : -1, self.count :] = np.eye(slacks)
        self.matrix[-1, : self.count] = 1.0
        self.right = np.zeros(len(self.matrix))
        self.right[-1] = 1.0

    def start(self) -> tuple[Array, Array, Array]:
        xi = np.full(self.count, 1.0 / self.count)
        slack = np.maximum(0.1, -self.matrix[self.m : -1, : self.count] @ xi)
        x = np.concatenate([xi, slack])
        y = np.zeros(len(self.matrix))
        y[-1] = p = float(self.prior.shape[0])
        return x, y, 0.1 * p / len(x) / x

    def information(self, x: Array) -> Array:
        stacked = (self.rows * np.sqrt(x[: self.count])[:, None, None]).reshape(-1, self.rows.shape[2])
        return np.asarray(self.prior + stacked.T @ stacked)

    def _whitened(self, x: Array) -> Array:
        """Return L^-1 B_k' [p, K n] with L L' = M."""
        factor = np.linalg.cholesky(self.information(x))
        stacked = self.rows.reshape(-1, self.rows.shape[2])
        return np.asarray(solve_triangular(factor, stacked.T, lower=True))

    def residual(self, x: Array, y: Array, z: Array, target: float) -> Array:
        """Return the residuals of stationarity, of the constraints and of complementarity."""
        slope = np.zeros(len(x))
        slope[: self.count] = -(self._whitened(x) ** 2).sum(axis=0).reshape(self.count, -1).sum(axis=1)
        return np.concatenate([slope + self.matrix.T @ y - z, self.matrix @ x - self.right, x * z - target])

    def step(self, x: Array, y: Array, z: Array, target: float) -> tuple[Array, Array, Array]:
        """Return the Newton step of the perturbed optimality conditions.

        (Q + Z/X) dx + E' dy = b with Q = R' R, the Hessian of -log det M; elimination of dx leaves a positive definite
        matrix in R dx and dy.
        """
        white = self._whitened(x)
        p = len(white)
        blocks = white.T.reshape(self.count, -1, p)
        upper = np.triu_indices(p)
        scale = np.where(upper[0] == upper[1], 1.0, np.sqrt(2.0))
        products = np.matmul(blocks.transpose(0, 2, 1), blocks)  # L^-1 A_k L^-T
        reduced = np.zeros((len(scale) + len(self.matrix), len(x)))
        reduced[: len(scale), : self.count] = (products[:, upper[0], upper[1]] * scale).T
        reduced[len(scale) :] = self.matrix
        slope = np.zeros(len(x))
        slope[: self.count] = -np.trace(products, axis1=1, axis2=2)
        b = -slope - self.matrix.T @ y + target / x
        inverse = x / z
        normal = (reduced * inverse) @ reduced.T
        diagonal = np.einsum("ii->i", normal)
        diagonal[: len(scale)] += 1.0
        diagonal[len(scale) :] *= 1.0 + 1e-13  # equalities that depend on one another
        diagonal[len(scale) :] += 1e-14 * float(diagonal.max())
        right = reduced @ (inverse * b)
        right[len(scale) :] += self.matrix @ x - self.right
        solved = cho_solve(cho_factor(normal), right)
        dx = inverse * (b - reduced.T @ solved)
        return dx, solved[len(scale) :], target / x - z - z / x * dx

    def solution(self, x: Array, y: Array, z: Array) -> Weights:
        return Weights(
            x[: self.count], self.information(x), y[: self.m], y[self.m : -1], total=float(y[-1]), gap=float(x @ z)
        )


_ADDED = 150  # states that a search adds at most
_POLISHED = 4
_STARTS = 140  # a joint
_LAST = 4  # times as wide is the search that the proof rests on
_KEPT = 600  # states kept from one search to the next besides the seeds: those of most weight
_SEARCHES = 60  # in one cell
_CUTS = 6  # directions of the band limit between two searches
_BROKEN = 0.01  # share by which a mean may break a limit that is added only when it is needed
_CELLS = 40
_EXACT = 0.05  # share of what is left to gain that the weights may miss
_STEADY = 0.5  # share of the best dual point in the one that is searched (in-out: Ben-Ameur and Neto 2007)


class Pool:
    """The states found so far, with their rows S^-1/2 Phi D [K, n, p]; the seeds, which come first, are never dropped.

    The seeds hold whole trajectories and poses at rest, so that a distribution which keeps all moments exists.
    """

    def __init__(self, motion: Motion, rows: Array) -> None:
        """Start from the seeds."""
        self.motion, self.rows, self._seeds = motion, rows, len(rows)

    def add(self, motion: Motion, rows: Array) -> None:
        """Add states."""
        self.motion, self.rows = joined([self.motion, motion]), np.concatenate([self.rows, rows])

    def drop_light(self, xi: Array) -> None:
        """Drop the states of least weight."""
        later = self._seeds + np.argsort(-xi[self._seeds :])[:_KEPT]
        chosen = np.concatenate([np.arange(self._seeds), np.sort(later)])
        self.motion, self.rows = self.motion[chosen], self.rows[chosen]


@dataclass(frozen=True)
class Measure:
    """A distribution over states: its weights, with the dual point that belongs to them."""

    motion: Motion
    weights: Weights
    moments: Moments

    def mean(self, values: Array) -> Array:
        """Return the mean [...] of values [K, ...] over the distribution."""
        return np.asarray(np.tensordot(self.weights.xi, values, axes=1))

    def prices(self) -> Prices:
        """Return the dual point as what a search maximises."""
        unequal = np.maximum(self.weights.unequal, 0.0)
        return Prices(
            np.asarray(np.linalg.inv(self.weights.information)), self.weights.equal, self.moments.compact(unequal)
        )

    def excess_of_band(self) -> Array | None:
        """Return the direction v [n] in which E[(v' ddq)^2] passes w_max^2 E[(v' dq)^2] most, None where none does."""
        top = self.moments.states.velocity
        ddq, dq = self.motion.ddq / top / self.moments.highest, self.motion.dq / top
        energy = self.mean(dq[:, :, None] * dq[:, None, :])
        values, vectors = np.linalg.eigh(self.mean(ddq[:, :, None] * ddq[:, None, :]) - energy)
        return np.asarray(vectors[:, -1] / top) if values[-1] > _BROKEN * np.trace(energy) else None

    def spread(self) -> tuple[int, float] | None:
        """Return the joint that breaks Wirtinger's inequality most, with its mean; None where all keep it."""
        mean = self.mean(self.motion.q)
        variance = self.mean(self.motion.q**2) - mean**2
        excess = self.moments.lowest**2 * variance / self.mean(self.motion.dq**2)
        joint = int(np.argmax(excess))
        return (joint, float(mean[joint])) if excess[joint] > 1.0 + _BROKEN else None


@dataclass(frozen=True)
class Proof:
    """What a dual point proves: log det <= upper, if no state has a larger reduced cost than `reduced_cost`.

    lower: log det of the best distribution found. reduced_cost: tr(Y A) - lambda' d/dt f - mu' h - p of the best state
    that the last search found (0 where the dual is optimal), in units of log det.
    """

    upper: float
    lower: float
    reduced_cost: float
    measure: Measure
    prices: Prices


class Relaxation:
    """max log det(M0 + E[A(x)]) over distributions of states x that keep the moments; A(x) = Phi' S^-1 Phi.

    For every Y > 0, lambda and mu >= 0, with nu the largest tr(Y A(x)) - lambda' d/dt f(x) - mu' h(x) over all states,
    log det(M0 + E[A]) <= -log det Y + p log((nu + tr(Y M0)) / p).
    """

    def __init__(
        self, oracle: Oracle, pool: Pool, prior: Array, deadline: float, progress: Callable[[Proof], None] | None = None
    ) -> None:
        """Take the search, its seeds and M0 [p, p]; deadline on time.monotonic()."""
        self._oracle, self._pool, self._prior = oracle, pool, prior
        self._deadline, self._progress = deadline, progress
        self._rng = np.random.default_rng(0)
        self._pace = 0.0  # s that a search takes with its weights
        self.searches = 0
        self.cells = 1

    def bound(self, moments: Moments, tolerance: float) -> Proof:
        """Return a proof for every mean of the positions, by branch and bound over cells of the means."""
        heap, reached = [self._leaf(self._solve(moments, tolerance), 0)], -np.inf
        while True:
            proof = heapq.heappop(heap)[-1]
            broken = proof.measure.spread() if moments.lowest > 0 else None
            done = proof.upper - reached < tolerance
            if broken is None or done or self.cells >= _CELLS or time.monotonic() > self._deadline:
                return proof
            for half in proof.measure.moments.split(*broken):
                found = self._solve(half, tolerance)
                if found.measure.spread() is None:  # a distribution that keeps Wirtinger's inequality
                    reached = max(reached, found.lower)
                self.cells += 1
                heapq.heappush(heap, self._leaf(replace(found, upper=min(found.upper, proof.upper)), self.cells))

    @staticmethod
    def _leaf(proof: Proof, number: int) -> tuple[float, int, Proof]:
        return -proof.upper, number, proof

    def _solve(self, moments: Moments, tolerance: float) -> Proof:
        """Return the proof for one cell, the last search for which is a wide one."""
        best: Proof | None = None
        for _ in range(_SEARCHES):
            began = time.monotonic()
            measure = self._master(moments, best, tolerance)
            moments = measure.moments
            prices = measure.prices()
            if best is not None:  # those of the weights swing far off at first
                prices = prices.towards(best.prices, _STEADY)
            proof = self._priced(measure, prices, _STARTS * moments.states.n, _POLISHED)
            self._pace = time.monotonic() - began
            if best is None or proof.upper < best.upper:
                best = proof
            best = replace(best, lower=max(best.lower, proof.lower))
            if self._progress is not None:
                self._progress(best)
            if time.monotonic() + (1 + _LAST) * self._pace > self._deadline:
                break
            if best.upper - best.lower < tolerance:
                best = self._confirmed(best)
                if best.upper - best.lower < tolerance:
                    return best
        assert best is not None
        return self._confirmed(best)

    def _priced(self, measure: Measure, prices: Prices, starts: int, polished: int) -> Proof:
        """Search for states of positive reduced cost at a dual point, add them, and return what the point proves."""
        heavy = np.argsort(-measure.weights.xi)[: starts // 2]
        beside = self._oracle.starts_beside(self._rng, measure.motion[heavy])
        random = self._oracle.random_starts(self._rng, starts - len(heavy))
        c, sign = (np.vstack(both) for both in zip(beside, random, strict=True))
        found = self._oracle.search(prices, c, sign, polished, _ADDED)
        self.searches += 1
        known = self._oracle.rewards(prices, self._pool.motion)
        if len(measure.weights.xi) == len(self._pool.rows):
            self._pool.drop_light(measure.weights.xi)
        self._pool.add(found.motion, found.rows)
        p = len(self._prior)
        total = max(float(found.reward.max(initial=-np.inf)), float(known.max()))
        total += float(np.sum(prices.inverse * self._prior))
        lower = float(np.linalg.slogdet(measure.weights.information)[1])
        upper = p * float(np.log(total / p)) - float(np.linalg.slogdet(prices.inverse)[1])
        return Proof(upper, lower, total - p, measure, prices)

    def _confirmed(self, proof: Proof) -> Proof:
        """Return the proof after a search at its dual point that is as much wider as time is left for."""
        measure, left = proof.measure, self._deadline - time.monotonic()
        width = int(min(_LAST, left / max(self._pace, 1e-3)))
        if width < 1:
            return proof
        again = self._priced(measure, proof.prices, width * _STARTS * measure.moments.states.n, width * _POLISHED)
        if again.reduced_cost <= proof.reduced_cost:
            return proof
        return replace(proof, upper=max(proof.upper, again.upper), reduced_cost=again.reduced_cost)

    def _master(self, moments: Moments, best: Proof | None, tolerance: float) -> Measure:
        """Return the best distribution over the pool, with the band limit in every direction that needs it."""
        ahead = np.inf if best is None else best.upper - best.lower
        gap = float(np.clip(_EXACT * ahead, 0.05 * tolerance, 0.1 * len(self._prior)))
        motion, equal = self._pool.motion, moments.equalities(self._pool.motion)
        for _ in range(_CUTS):
            unequal = moments.inequalities(motion)
            weights = maximise_log_det(self._pool.rows, equal, unequal, self._prior, gap)
            measure = Measure(motion, weights, moments)
            v = measure.excess_of_band()
            if v is None:
                break
            moments = moments.with_direction(v)
        return measure
