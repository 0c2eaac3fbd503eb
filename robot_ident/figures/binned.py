"""A residual's mean along a variable, in bins that hold equally many rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.signals.motion import Array, Mask


@dataclass(frozen=True)
class Binned:
    """Of K bins: the middle of the variable, mean of the residual [Nm], and the standard deviation that noise alone
    gives that mean (nan where unknown).
    """

    middle: Array
    mean: Array
    spread: Array


def binned(
    x: Sequence[Array], y: Sequence[Array], used: Sequence[Mask], variance: Sequence[float], bins: int
) -> Binned:
    """Return the mean of y over x, recordings together; variance: of the noise of an independent row of each."""
    values = np.concatenate([one[u] for one, u in zip(x, used, strict=True)])
    rest = np.concatenate([one[u] for one, u in zip(y, used, strict=True)])
    noise = np.concatenate([np.full(int(u.sum()), v) for u, v in zip(used, variance, strict=True)])
    if not len(values):
        nothing = np.zeros(0)
        return Binned(nothing, nothing, nothing)
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, max(0, len(edges) - 2))
    count = np.bincount(place, minlength=max(1, len(edges) - 1)).astype(float)
    some = count > 0
    count = count[some]

    def mean(of: Array) -> Array:
        return np.asarray(np.bincount(place, of, len(some))[some] / count)

    return Binned(mean(values), mean(rest), np.sqrt(mean(noise) / count))
