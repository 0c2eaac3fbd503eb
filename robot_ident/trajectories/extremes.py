"""The minimum of a function of time, proven by halving intervals until none has room for a smaller value."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from robot_ident.signals.motion import Array, Mask

_BUDGET = 400_000  # intervals


class Minimum(NamedTuple):
    """A proven lower bound, the smallest value found and its time [s]."""

    lower: float
    value: float
    time: float


def certified_minimum(
    bound: Callable[[Array, Array], tuple[Array, Array]],
    start: float,
    end: float,
    tolerance: float,
) -> Minimum:
    """Return the minimum over [start, end] to within `tolerance`.

    `bound(centres [N], half_widths [N])` gives the value at the centre of N intervals and a lower bound over each of
    them [N]. Where the budget of intervals is spent the lower bound is wider than the tolerance, but still proven.
    """
    centres, halves = intervals(start, end, 64)
    best, time, spent = np.inf, start, 0
    while True:
        values, lower = bound(centres, halves)
        k = int(np.argmin(values))
        if values[k] < best:
            best, time = float(values[k]), float(centres[k])
        open_ = lower < best - tolerance
        spent += len(centres)
        if not open_.any():
            return Minimum(best - tolerance, best, time)
        if spent > _BUDGET:
            return Minimum(float(min(lower.min(), best - tolerance)), best, time)
        centres, halves = halved(centres, halves, open_)


def certified_positive(bound: Callable[[Array, Array], tuple[Array, Array]], start: float, end: float) -> bool:
    """Return whether a function is proven to be positive over [start, end]; much quicker than its minimum."""
    (centres, halves), spent = intervals(start, end, 32), 0
    while spent < _BUDGET:
        values, lower = bound(centres, halves)
        if np.any(values <= 0.0):
            return False
        open_ = lower <= 0.0
        if not open_.any():
            return True
        spent += len(centres)
        centres, halves = halved(centres, halves, open_)
    return False


def intervals(start: float, end: float, count: int) -> tuple[Array, Array]:
    """Return the centres and half widths [count] of equal intervals of [start, end]."""
    edges = np.linspace(start, end, count + 1)
    return 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)


def halved(centres: Array, halves: Array, rows: Mask) -> tuple[Array, Array]:
    """Return the two halves of the chosen intervals, beside each other."""
    half = np.repeat(0.5 * halves[rows], 2)
    return np.repeat(centres[rows], 2) + np.tile([-1.0, 1.0], int(rows.sum())) * half, half
