"""Column generation: the best distribution over states, and what its dual proves."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.excitation.bound.max_det import Weights, maximise_log_det
from robot_ident.excitation.bound.moments import Moments
from robot_ident.excitation.bound.oracle import Oracle, Prices
from robot_ident.excitation.bound.seeds import stacked
from robot_ident.signals.motion import Array, Motion

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
        self.motion = stacked([self.motion, motion])
        self.rows = np.concatenate([self.rows, rows])

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
        self,
        oracle: Oracle,
        pool: Pool,
        prior: Array,
        deadline: float,
        progress: Callable[[Proof], None] = lambda proof: None,
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
            proof = self._priced(measure, self._between(best, measure), _STARTS * moments.states.n, _POLISHED)
            self._pace = time.monotonic() - began
            if best is None or proof.upper < best.upper:
                best = proof
            best = replace(best, lower=max(best.lower, proof.lower))
            self._progress(best)
            if time.monotonic() + (1 + _LAST) * self._pace > self._deadline:
                break
            if best.upper - best.lower < tolerance:
                best = self._confirmed(best)
                if best.upper - best.lower < tolerance:
                    return best
        assert best is not None
        return self._confirmed(best)

    @staticmethod
    def _between(best: Proof | None, measure: Measure) -> Prices:
        """Return a dual point between the best one and that of the weights, which swings far off at first."""
        fresh = measure.prices()
        return fresh if best is None else fresh.towards(best.prices, _STEADY)

    def _priced(self, measure: Measure, prices: Prices, starts: int, polished: int) -> Proof:
        """Search for states of positive reduced cost at a dual point, add them, and return what the point proves."""
        heavy = np.argsort(-measure.weights.xi)[: starts // 2]
        beside = self._oracle.starts_beside(self._rng, measure.motion[heavy], 0.05)
        random = self._oracle.random_starts(self._rng, starts - len(beside))
        found = self._oracle.search(prices, [*beside, *random], polished, _ADDED)
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
