"""Samples off the clock, as the scatter of a repeating motion tells: all joints are off along their speeds at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.motion import Array
from robot_ident.recording.noise import mean_of_periods


@dataclass(frozen=True)
class OffClock:
    """By how much the instants of samples scatter about their stamps [samples, rms], and how many standard deviations
    the evidence is from none.
    """

    size: float
    sigmas: float


def off_clock(q: Array) -> OffClock | None:
    """Return the scatter of instants from periods of positions q [M, N, n], gaps nan; None for a single joint.

    A sample late by e moves joint i by dq_i e, so that r_i r_j has mean dq_i dq_j s^2 for every pair of joints, while
    noise of their own leaves it at 0. Differences of neighbouring samples are taken: what drifts slowly, a path that
    doesn't repeat for one, drops out. The spread between periods tells the uncertainty.
    """
    periods, _, joints = q.shape
    if joints < 2 or periods < 4:
        return None
    mean = mean_of_periods(q)
    speed = (np.roll(mean, -1, axis=0) - np.roll(mean, 1, axis=0)) / 2.0
    rate = (speed[1:] + speed[:-1]) / 2.0
    rest = [np.nan_to_num(np.diff(q[:, :, j] - mean[:, j], axis=1)) for j in range(joints)]
    # of a sample: a difference has twice its variance
    scale = np.array([np.sqrt(np.mean(one**2) / 2.0) for one in rest])
    if not np.all(scale > 0.0):
        return None
    rate /= scale  # joints with little noise tell most
    weight, found = 0.0, np.zeros(periods)
    for i in range(joints):
        for j in range(i):
            both = rate[:, i] * rate[:, j]
            found += np.einsum("mk,mk,k->m", rest[i], rest[j], both / (2.0 * scale[i] * scale[j]))
            weight += float(both @ both)
    if weight <= 0.0:
        return None
    variance = found / weight * periods / (periods - 1)  # the mean has taken its share of the scatter
    spread = float(np.std(variance, ddof=1) / np.sqrt(periods))
    centre = float(variance.mean())
    return OffClock(float(np.sqrt(max(centre, 0.0))), centre / spread if spread > 0.0 else 0.0)
