"""Tells when somebody sets a clock: stamps are of it, while deadlines are of one that nobody sets."""

from __future__ import annotations

import time
from collections.abc import Callable

_STEP = 50_000_000  # ns by which the clocks must be further apart than before
_READ = 5_000_000  # ns that reading both may take


class SetClock:
    """Holds a clock against the machine's monotonic one, which is slewed as the machine's clock is, but never set."""

    def __init__(self, now_ns: Callable[[], int], monotonic_ns: Callable[[], int] = time.monotonic_ns) -> None:
        """Watch the clock now_ns()."""
        self._now_ns, self._monotonic_ns = now_ns, monotonic_ns
        self._apart: int | None = None

    def step(self) -> float:
        """Return by how much the clock was set since the last look [s]; 0 where it was not."""
        before, now = self._monotonic_ns(), self._now_ns()
        if self._monotonic_ns() - before > _READ:  # this process stood still between the two
            return 0.0
        apart = now - before
        step = 0 if self._apart is None else apart - self._apart
        if self._apart is None or abs(step) > _STEP:
            self._apart = apart
        return 1e-9 * step if abs(step) > _STEP else 0.0
