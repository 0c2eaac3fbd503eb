"""What a stream of messages says about its own losses: from its stamps and from the sender's numbers."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, field

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
