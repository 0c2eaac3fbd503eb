"""The effort of one joint over time, where it comes by other messages than the positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_ident.motion import Array

_GAP = 5.0  # times the usual step between two efforts: what lies further apart is not interpolated


@dataclass(frozen=True)
class EffortSeries:
    """The effort of one joint: stamps [k] ns, increasing, and values [k], in the unit in which it is reported."""

    stamp: NDArray[np.int64]
    value: Array

    def at(self, t: Array, start: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return it at instants t [N] s since `start` ns, linear between stamps, and whether it is known there.

        It is where there are efforts on both sides, no further apart than `_GAP` usual steps, or one at the instant; up
        to half a step beyond either end it stays what it is there.
        """
        own = (self.stamp - start) / 1e9
        usual = np.median(np.diff(own)) if len(own) > 1 else 0.0
        right = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
        left = np.where(own[right] <= t, right, np.maximum(right - 1, 0))
        inside = (t >= own[0] - 0.5 * usual) & (t <= own[-1] + 0.5 * usual)
        return np.interp(t, own, self.value), inside & (own[right] - own[left] <= _GAP * usual)
