"""How many periods of a motion make a parameter so precise: noise averages out with their number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.signals.motion import Array

_MOST = 1_000_000  # periods: more are never
_OPEN = 1e-6  # share of a direction that no data tell, from which on a parameter is not told either


@dataclass(frozen=True)
class Needed:
    """Periods after which a parameter's standard deviation is the share of its value that was asked for.

    sigma: of one period alone (and a prior). periods: None where no number of them is enough, or the value is not
    known.
    """

    name: str
    value: float
    sigma: float
    periods: int | None
    unit: str


def periods_needed(
    information: Array,
    values: Array,
    names: Sequence[str],
    units: Sequence[str],
    share: float,
    prior: Array | None = None,
) -> tuple[Needed, ...]:
    """Return how many periods each parameter takes: the least M with sigma_M <= share |value|.

    sigma_M^2 = diag (prior + M J)^-1, J [p, p] the information of one period (Swevers et al. 1997, eq. 9), for noise
    alone: what a model lacks does not average out. values [p], 0 where they are not known.
    """
    deviations = _Deviations(information, prior)
    one = deviations(1)
    return tuple(
        Needed(name, float(value), float(one[k]), deviations.periods(k, share * abs(float(value))), unit)
        for k, (name, value, unit) in enumerate(zip(names, values, units, strict=True))
    )


class _Deviations:
    """Standard deviations [p] after so many periods."""

    def __init__(self, information: Array, prior: Array | None) -> None:
        self._scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        unit = np.outer(self._scale, self._scale)
        self._one, self._known = information / unit, np.zeros_like(unit) if prior is None else prior / unit

    def __call__(self, periods: int) -> Array:
        values, vectors = np.linalg.eigh(self._known + periods * self._one)
        told = values > len(values) * np.finfo(float).eps * values[-1]
        variance = (vectors[:, told] ** 2) @ (1.0 / values[told])
        variance[np.any(np.abs(vectors[:, ~told]) > _OPEN, axis=1)] = np.inf
        return np.asarray(np.sqrt(variance) / self._scale)

    def periods(self, parameter: int, wanted: float) -> int | None:
        """Return the least number after which a parameter's deviation is no more than `wanted`, None for never."""
        if wanted <= 0.0 or self(_MOST)[parameter] > wanted:
            return None
        low, high = 0, _MOST
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self(middle)[parameter] <= wanted else (middle, high)
        return high
