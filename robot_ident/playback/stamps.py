"""What a stream of messages says of itself: losses, a clock that somebody sets, efforts beside positions."""

from __future__ import annotations

import statistics
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from robot_ident.recording.effort import effort_at
from robot_ident.signals.motion import Array

_LEARN = 32  # intervals from which the usual one is learnt
_FOLLOW = 0.01  # share by which each further interval moves it
_GAP = 1.6  # intervals; longer means that something is missing
_SENDERS = 16  # senders told apart by their numbers
_LEAP = 500  # numbers; a longer step is another sender (a real loss of this size shows as a gap in the stamps as well)


@dataclass
class SequenceWatch:
    """Counts the numbers that are missing where senders number their messages 1, 2, 3... and don't say who they are.

    A message continues the sender whose last number it follows most closely.
    """

    lost: int = 0
    _last: list[int] = field(default_factory=list)

    def add(self, number: int) -> None:
        """Take in the number of a message."""
        behind = [(number - last, place) for place, last in enumerate(self._last) if 0 < number - last <= _LEAP]
        if not behind:
            self._last = [*self._last[-_SENDERS + 1 :], number]
            return
        step, place = min(behind)
        self.lost += step - 1
        self._last[place] = number


@dataclass
class StampWatch:
    """Counts the gaps, duplicates and late messages of one topic; stamps in ns, 0 where there is none.

    missing: samples that fit into the gaps, at the usual interval. longest: the longest interval [ns].
    """

    received: int = 0
    missing: int = 0
    gaps: int = 0
    duplicates: int = 0
    late: int = 0
    longest: int = 0
    interval: float = 0.0
    first: int = 0
    last: int = 0
    _learnt: list[int] = field(default_factory=list)

    def add(self, stamp: int) -> None:
        """Take in the stamp of a message."""
        self.received += 1
        if not stamp:
            return
        if not self.last:
            self.first = self.last = stamp
            return
        step = stamp - self.last
        if step <= 0:
            self.duplicates += step == 0
            self.late += step < 0
            return
        self.last = stamp
        self.longest = max(self.longest, step)
        if len(self._learnt) < _LEARN:
            self._learnt.append(step)
            self.interval = float(statistics.median(self._learnt))
            if len(self._learnt) == _LEARN:
                for early in self._learnt:
                    self._judge(early)
            return
        if self._judge(step):
            self.interval += _FOLLOW * (step - self.interval)

    def _judge(self, step: int) -> bool:
        """Count what is missing in one interval; return whether it is a usual one."""
        if step <= _GAP * self.interval:
            return True
        self.gaps += 1
        self.missing += max(round(step / self.interval) - 1, 1)
        return False

    @property
    def rate(self) -> float:
        """The usual rate [Hz], 0 where it isn't known."""
        return 1e9 / self.interval if self.interval else 0.0


def header_stamp(data: bytes) -> int:
    """Return the stamp [ns] at the head of a serialized message whose first field is a std_msgs/Header."""
    order = "little" if data[1] & 1 else "big"
    seconds = int.from_bytes(data[4:8], order, signed=True)  # type: ignore[arg-type]
    return seconds * 1_000_000_000 + int.from_bytes(data[8:12], order)  # type: ignore[arg-type]


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

    def add_position(self, stamp_ns: int, received_ns: int, q: Array, tau: Array | None) -> None:
        """Take in positions q [n] rad with the efforts tau [n] of the same message, None where it has none.

        stamp_ns: 0 where it has none either. A stamp that goes back begins anew: a clock jumped, or a replay began.
        """
        if stamp_ns:
            self._delays.append(received_ns - stamp_ns)
        if tau is None and len(self._places) < len(q):
            return
        stamp = stamp_ns or received_ns
        if self._waiting and stamp < self._waiting[-1][0]:
            self._waiting.clear()
        self._waiting.append((stamp, q, np.full(len(q), np.nan) if tau is None else tau))

    def add_efforts(self, stamp_ns: int, received_ns: int, values: Mapping[str, float]) -> None:
        """Take in the efforts of some joints; stamp_ns: 0 where the message has none."""
        stamp = stamp_ns or received_ns - int(np.median(self._delays or [0]))
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
        before = ready[-1][0] if ready else last - _PATIENCE
        for series in self._efforts.values():
            while len(series) > _BEFORE and series[_BEFORE][0] < before:
                series.popleft()
        return paired

    def _beside(self, ready: Sequence[tuple[int, Array, Array]]) -> list[Paired]:
        start = ready[0][0]
        t = np.array([stamp - start for stamp, _, _ in ready]) / 1e9
        tau, kept = np.array([effort for _, _, effort in ready]), np.ones(len(ready), dtype=bool)
        for joint, series in self._efforts.items():
            stamps, values = zip(*series, strict=True)
            tau[:, self._places[joint]], there = effort_at(t, start, np.array(stamps), np.array(values))
            kept &= there
        return [Paired(stamp, q, row) for (stamp, q, _), row, there in zip(ready, tau, kept, strict=True) if there]
