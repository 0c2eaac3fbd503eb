"""Lets commands wait a moment, so that those which come late don't disturb the motion."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from robot_ident.signals.motion import Array

_FOREIGN_NS = 1_000_000_000  # a stamp further from the receive time than this is of another clock


@dataclass(frozen=True)
class Command:
    """A command of stamp t_ns [ns]: q [n] rad, dq [n] rad/s."""

    t_ns: int
    q: Array
    dq: Array


class CommandBuffer:
    """Hands out each command `delay` seconds after its stamp, whatever its way took, in the order of the stamps.

    A missing stamp, or one of another clock, is replaced by the receive time. One thread fills it, another empties it.
    """

    def __init__(self, delay: float) -> None:
        """Hold commands back for `delay` [s]."""
        self.delay_ns = round(delay * 1e9)
        self._commands: deque[Command] = deque()

    def put(self, stamp_ns: int, received_ns: int, q: Array, dq: Array) -> None:
        """Take in a command; one that is older than its predecessor is left out."""
        t = stamp_ns if abs(stamp_ns - received_ns) < _FOREIGN_NS else received_ns
        if not self._commands or t > self._commands[-1].t_ns:
            self._commands.append(Command(t, q, dq))

    def due(self, now_ns: int) -> list[Command]:
        """Return the commands whose time has come, the oldest first."""
        out = []
        while self._commands and self._commands[0].t_ns + self.delay_ns <= now_ns:
            out.append(self._commands.popleft())
        return out

    def shift(self, by_ns: int) -> None:
        """Let the stamps of what waits go along with a clock that has jumped by so much [ns]."""
        for k in range(len(self._commands)):  # those that come meanwhile are of the new time
            self._commands[k] = replace(self._commands[k], t_ns=self._commands[k].t_ns + by_ns)

    def clear(self) -> None:
        """Forget what waits."""
        self._commands.clear()
