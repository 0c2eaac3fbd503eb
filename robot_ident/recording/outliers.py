"""Periods that are not like the others: somebody leant on the arm, a message burst was lost, a contact."""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array

_BLOCKS = 25  # stretches of a period that are judged one by one
_RATIO = {"torque": 4.0, "position": 25.0}  # of the usual scatter, in power: less does no harm to the average
_SPREAD = 8.0  # robust standard deviations of the logarithm
_LEAST = 4  # periods, below which no majority says what is usual
_SHARE = 0.25  # of the periods, above which they are not outliers but another state of the robot


def outlying_periods(periods: Array, what: str = "torque") -> list[int]:
    """Return which of the periods [M, N, n] (gaps nan) scatter far more about the median period than is usual.

    The mean square of each stretch, period and joint is compared with its median over the periods; an outlier exceeds
    it by a factor (4 for torque) and by 8 robust standard deviations of the logarithm.
    """
    count, samples, n = periods.shape
    if count < _LEAST or samples < 4 * _BLOCKS:
        return []
    edges = np.linspace(0, samples, _BLOCKS + 1).astype(int)
    found = np.full((count, _BLOCKS, n), np.nan)
    for block, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        piece = periods[:, first:last] - np.nanmedian(periods[:, first:last], axis=0)
        present = np.isfinite(piece).sum(axis=1)
        energy = np.nansum(piece**2, axis=1)
        found[:, block] = np.where(present >= 4, energy / np.maximum(present, 1), np.nan)
    usual = np.nanmedian(found, axis=0)
    ratio = found / np.where(usual > 0, usual, np.inf)
    logarithm = np.log(np.maximum(ratio, 1e-12))
    spread = 1.4826 * np.nanmedian(np.abs(logarithm[ratio > 0])) if np.any(ratio > 0) else 0.0
    bound = max(np.log(_RATIO[what]), _SPREAD * spread)
    outlying = np.flatnonzero(np.nanmax(np.nan_to_num(logarithm, nan=-np.inf), axis=(1, 2)) > bound)
    return [int(m) for m in outlying] if len(outlying) <= _SHARE * count else []
