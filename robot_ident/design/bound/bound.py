"""The smallest determinant that any trajectory within a robot's limits could reach."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.design.bound.moments import Moments, StateSet
from robot_ident.design.bound.oracle import Oracle, seed_motions
from robot_ident.design.bound.relaxation import Pool, Proof, Relaxation
from robot_ident.design.family import Family
from robot_ident.design.target import Target
from robot_ident.errors import InputError
from robot_ident.limits.feasibility import require_limits
from robot_ident.model.expressions import columns_function
from robot_ident.signals.motion import Array

TIME_LIMIT = 60.0  # s
TIGHT = 0.03  # share of the D-efficiency within which a bound is as good as its relaxation gives
_MANY_JOINTS = 4  # beyond which moments of degree 3 (679 for seven joints) cost more than they tighten
_RANDOM_STATES = 500  # a joint


@dataclass(frozen=True)
class Bound:
    """log10 det of the covariance that no trajectory of this kind can fall below.

    relaxed: what the best distribution over states reaches; no longer search could lift the bound above it.
    largest_reduced_cost c: of the best state that the last search found, in units of log det. It is counted in the
    bound, which lies p log10(1 + c / p) below what the dual would prove with c = 0; a state that the search missed
    would lower it in the same way.
    """

    log10_det_covariance: float
    relaxed: float
    largest_reduced_cost: float
    parameters: int
    degree: int
    cells: int
    searches: int
    seconds: float

    def efficiency(self, log10_det_covariance: float) -> float:
        """Return the D-efficiency (det_bound / det)^(1/p) of what was achieved; 1 where nothing better can exist."""
        return float(10.0 ** ((self.log10_det_covariance - log10_det_covariance) / self.parameters))

    def explanation(self) -> str:
        """Return in words what the bound rests on."""
        words = (
            "The bound is that of the best distribution over the states within the limits (moments of degree"
            f" {self.degree} and the band of the harmonics kept), which no motion has to reach. Its dual proves it as"
            " far as a multi-start search over the states is complete: the last one found a reduced cost of"
            f" {self.largest_reduced_cost:.2g}, which is counted in."
        )
        if self.relaxed - self.log10_det_covariance > self.parameters * np.log10(1.0 + 1.5 * TIGHT):
            words += f" More time would tighten it, to {self.relaxed:.2f} at most."
        return words

    def to_json(self, log10_det_covariance: float) -> dict[str, Any]:
        """Return the bound as plain values, with the efficiency of what was achieved."""
        return {
            "log10_det_covariance": self.log10_det_covariance,
            "d_efficiency": self.efficiency(log10_det_covariance),
            "relaxed": self.relaxed,
            "largest_reduced_cost": self.largest_reduced_cost,
            "degree": self.degree,
            "cells": self.cells,
            "searches": self.searches,
            "seconds": self.seconds,
        }


def determinant_bound(
    target: Target,
    family: Family,
    *,
    trajectories: int = 1,
    prior: Array | None = None,
    degree: int | None = None,
    time_limit: float = TIME_LIMIT,
    progress: Callable[[Proof], None] | None = None,
) -> Bound:
    """Return a bound of det (M0 + F' S^-1 F)^-1 over all motions of a family within the limits of a target's robot.

    The samples of a motion are replaced by the best distribution over the states (q, dq, ddq) that it may pass, which
    keeps what every such motion keeps on average (`StateSet`, `Moments`): K motions of N samples have F' S^-1 F =
    K N E[Phi' S^-1 Phi]. Limits of torque and self-collision, and harmonics left out between the lowest and the
    highest, are ignored, which can only loosen it. prior M0 [p, p]: information that is there already. degree: of the
    polynomials whose rate has mean zero (3, or 2 from five joints on). Stops within 3 % of the efficiency or after
    time_limit [s]; the bound holds at any time. The dual proves it up to the completeness of a multi-start search over
    the states. Raises InputError where limits are missing or can't be met, and for effects with memory, whose columns
    are no function of the state.
    """
    structure, robot, started = target.structure, target.robot, time.monotonic()
    require_limits(robot)
    if memory := [effect.label for effect in structure.effects if not effect.symbolic]:
        raise InputError(
            f"no bound of the determinant with {', '.join(memory)}: the column is no function of the state"
        )
    p = len(structure.names)
    degree = degree or (3 if robot.n <= _MANY_JOINTS else 2)
    degree = min(degree, (family.samples - 1) // family.harmonics)  # a higher product's mean would alias
    w = 2.0 * np.pi * family.base_frequency
    lowest, highest = w * family.orders[0], w * family.harmonics
    states = StateSet.of(robot, lowest, highest)
    # Motions of different means: their mixture may spread more than Wirtinger allows to each.
    moments = Moments.of(states, lowest if trajectories == 1 else 0.0, highest, degree)
    oracle, pool, scale = _seeded(target, family, moments, family.samples * trajectories)
    known = np.zeros((p, p)) if prior is None else scale[:, None] * prior * scale
    relaxation = Relaxation(oracle, pool, known, started + time_limit, progress)
    proof = relaxation.bound(moments, p * float(np.log1p(TIGHT)))
    shift = 2.0 * float(np.log(scale).sum())
    return Bound(
        log10_det_covariance=(shift - proof.upper) / float(np.log(10.0)),
        relaxed=(shift - proof.lower) / float(np.log(10.0)),
        largest_reduced_cost=proof.reduced_cost,
        parameters=p,
        degree=degree,
        cells=relaxation.cells,
        searches=relaxation.searches,
        seconds=time.monotonic() - started,
    )


def _seeded(target: Target, family: Family, moments: Moments, samples: int) -> tuple[Oracle, Pool, Array]:
    """Return the search, its first states, and the scale D [p] that brings the columns' mean squares to one."""
    robot, states = target.robot, moments.states
    phi = columns_function(target.structure, values=target.values)
    weight, rng = np.sqrt(samples / target.variances), np.random.default_rng(0)
    plain = Oracle(robot, phi, moments, np.ones(len(target.structure.names)), weight)
    count = _RANDOM_STATES * min(robot.n, _MANY_JOINTS)
    c, sign = plain.allowed(*plain.random_starts(rng, count))
    squares = (plain.rows(c, sign)[1] ** 2).sum(axis=1).mean(axis=0)
    scale = 1.0 / np.sqrt(np.where(squares > 0.0, squares, 1.0))
    oracle = Oracle(robot, phi, moments, scale, weight)
    pool = Pool(*oracle.rows(*states.coordinates(seed_motions(robot, states, rng, family))))
    pool.add(*oracle.rows(c, sign))
    return oracle, pool, scale
