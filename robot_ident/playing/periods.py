"""Counts the periods of a motion while it goes on."""

from __future__ import annotations

from collections import deque

import numpy as np

from robot_ident.signals.motion import Array

_MOVES = 1e-2  # rad; a motion smaller than this is a robot at rest, which repeats itself trivially
_ALIKE = 3e-3  # share of the range of a joint within which two periods are the same
_NOISE = 3e-4  # rad by which they may differ in any case
_GLITCH = 0.03  # share of a period for which they may differ by more
_SURE = 0.05  # share of a period by which the last one is waited for
_LOOKS = 16  # times a period that the range of the motion is looked at


class PeriodCounter:
    """Says how many whole periods in a row a robot has repeated: q(t) = q(t - T).

    It only decides *when* to identify; which samples are steady is judged again, and finer, from the whole recording.
    """

    def __init__(self, period: float) -> None:
        """Count periods of `period` [s]."""
        self.period = period
        self._samples: deque[tuple[float, Array]] = deque()
        self._since: float | None = None
        self._agreed = -np.inf
        self._range: Array = np.zeros(1)
        self._looked = -np.inf
        self._told = False

    @property
    def periods(self) -> float:
        """Periods that the present stretch of repetition covers, 0 where nothing moves or repeats."""
        return 0.0 if self._since is None else (self._agreed - self._since) / self.period + 1.0

    def add(self, t: float, q: Array, wanted: int = 0) -> bool:
        """Take in the positions [n] at t [s]; return whether it is time to identify, once a stretch of repetition.

        It is when `wanted` whole periods have been seen, or when the repetition ends after at least two. A time that
        runs backwards begins anew.
        """
        if self._samples and t <= self._samples[-1][0]:
            self._samples.clear()
            self._since, self._looked = None, -np.inf
        self._samples.append((t, q))
        before = self._position(t - self.period)
        if before is None:
            return False
        if t - self._looked > self.period / _LOOKS:
            self._looked = t
            self._range = np.ptp(np.array([sample[1] for sample in self._samples]), axis=0)
        if not np.any(self._range > _MOVES):
            self._since = None
            return False
        if np.all(np.abs(q - before) <= _ALIKE * self._range + _NOISE):
            if self._since is None:
                self._since, self._told = t, False
            self._agreed = t
            return not self._told and wanted > 0 and self._tell(wanted + _SURE)
        if self._since is None or t - self._agreed <= _GLITCH * self.period:
            return False
        due = not self._told and self._tell(1.8)
        self._since = None
        return due

    def _tell(self, least: float) -> bool:
        self._told = self.periods >= least
        return self._told

    def _position(self, t: float) -> Array | None:
        """Return the positions at an earlier time, between two samples, and forget what is older."""
        samples = self._samples
        while len(samples) > 2 and samples[1][0] <= t:
            samples.popleft()
        (t0, q0), (t1, q1) = samples[0], samples[min(1, len(samples) - 1)]
        if not t0 <= t < t1:
            return None
        share = (t - t0) / (t1 - t0)
        return q0 + share * (q1 - q0)
