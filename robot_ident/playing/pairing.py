"""Puts efforts that come by messages of their own beside the positions, while both are coming in."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.recording.effort import EffortSeries
from robot_ident.signals.motion import Array

_PATIENCE = 1_000_000_000  # ns for which a position waits for efforts after it
_BEFORE = 16  # efforts kept before the latest position that was paired
_DELAYS = 200  # positions of which the usual delay is learnt


@dataclass(frozen=True)
class Paired:
    """Position q [n] rad and effort tau [n], as reported, at one stamp [ns]."""

    stamp_ns: int
    q: Array
    tau: Array


class Pairing:
    """Efforts at the positions' stamps, as the reader of bags gives them: linear between the two next to a stamp.

    A position waits until every effort that it lacks has come for an instant after it; one that waits longer than a
    second is dropped, and so is one in a hole of the efforts. Efforts without a stamp count from their receipt, less
    the usual time from the positions' stamps to theirs.
    """

    def __init__(self, joints: Sequence[str], elsewhere: Sequence[str]) -> None:
        """Pair positions of `joints` with efforts that come beside them, but for the joints `elsewhere`."""
        self._places = {joint: list(joints).index(joint) for joint in elsewhere}
        self._waiting: deque[tuple[int, Array, Array]] = deque()
        self._efforts: dict[str, deque[tuple[int, float]]] = {joint: deque() for joint in elsewhere}
        self._delays: deque[int] = deque(maxlen=_DELAYS)
        self._delay: int | None = None

    def add_position(self, stamp_ns: int, received_ns: int, q: Array, tau: Array | None) -> None:
        """Take in positions q [n] rad with the efforts tau [n] of the same message, None where it has none.

        stamp_ns: 0 where it has none either. A stamp that goes back begins anew: a clock jumped, or a replay began.
        """
        if stamp_ns:
            self._delays.append(received_ns - stamp_ns)
            self._delay = None
        if tau is None and len(self._places) < len(q):
            return
        stamp = stamp_ns or received_ns
        if self._waiting and stamp < self._waiting[-1][0]:
            self._waiting.clear()
        self._waiting.append((stamp, q, np.full(len(q), np.nan) if tau is None else tau))

    def add_efforts(self, stamp_ns: int, received_ns: int, values: Mapping[str, float]) -> None:
        """Take in the efforts of some joints; stamp_ns: 0 where the message has none."""
        stamp = stamp_ns or received_ns - self._usual_delay()
        for joint, value in values.items():
            series = self._efforts[joint]
            if series and stamp < series[-1][0] - _PATIENCE:
                series.clear()
            if np.isfinite(value) and (not series or stamp > series[-1][0]):
                series.append((stamp, value))

    def take(self) -> list[Paired]:
        """Return the positions whose efforts are known by now, in order, once each."""
        if not self._waiting:
            return []
        last = self._waiting[-1][0]
        known = min((series[-1][0] if series else -1 for series in self._efforts.values()), default=last)
        ready = []
        while self._waiting and self._waiting[0][0] <= known:
            ready.append(self._waiting.popleft())
        while self._waiting and self._waiting[0][0] < last - _PATIENCE:
            self._waiting.popleft()
        paired = self._beside(ready) if ready else []
        self._forget_before(ready[-1][0] if ready else last - _PATIENCE)
        return paired

    def _beside(self, ready: Sequence[tuple[int, Array, Array]]) -> list[Paired]:
        start = ready[0][0]
        t = np.array([stamp - start for stamp, _, _ in ready]) / 1e9
        tau, kept = np.array([effort for _, _, effort in ready]), np.ones(len(ready), dtype=bool)
        for joint, series in self._efforts.items():
            stamps, values = zip(*series, strict=True)
            tau[:, self._places[joint]], there = EffortSeries(np.array(stamps), np.array(values)).at(t, start)
            kept &= there
        return [Paired(stamp, q, row) for (stamp, q, _), row, there in zip(ready, tau, kept, strict=True) if there]

    def _forget_before(self, stamp: int) -> None:
        for series in self._efforts.values():
            while len(series) > _BEFORE and series[_BEFORE][0] < stamp:
                series.popleft()

    def _usual_delay(self) -> int:
        if self._delay is None:
            self._delay = int(np.median(self._delays)) if self._delays else 0
        return self._delay
