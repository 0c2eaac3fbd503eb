"""Fewer points of long curves, with every extreme kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.motion import Array

POINTS = 2000
"""Points of a curve at most; about as many as a page is wide in pixels."""


def extremes(y: Array, points: int = POINTS) -> NDArray[np.int64]:
    """Return which rows of a curve y [N] to draw: all where there are few, else the smallest and the largest of every
    one of `points / 2` stretches of equal length, in their order.

    No peak is lost and none is made. A stretch with nothing finite gives one of its rows, so that a gap stays a gap.
    """
    if len(y) <= points:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), points // 2 + 1).astype(np.int64)
    low = np.where(np.isfinite(y), y, np.inf)
    high = np.where(np.isfinite(y), y, -np.inf)
    chosen = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        chosen += sorted({int(a + np.argmin(low[a:b])), int(a + np.argmax(high[a:b]))})
    return np.array(chosen, dtype=np.int64)


def extremes_along(x: Array, y: Array, points: int = POINTS) -> NDArray[np.int64]:
    """Return which rows of a cloud (x, y) [N] to draw: smallest and largest y of every one of `points / 2` stretches
    of x that hold equally many, in the order of x.
    """
    order = np.argsort(x, kind="stable")
    return order[extremes(y[order], points)]
