"""Calls a function on an even time grid, in its own thread, by absolute deadlines."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

_POLL = 0.001  # s; a clock that isn't the machine's own can only be asked again and again
_STALE = 0.5  # s of real time between two looks at such a clock, after which its last word counts no more
_NEWS = 0.1  # s


@dataclass(frozen=True)
class Timing:
    """How well the grid was kept: ticks done and missed, the worst lateness [s], stalls that moved the grid."""

    ticks: int = 0
    missed: int = 0
    worst: float = 0.0
    stalls: int = 0


@dataclass(frozen=True)
class Stall:
    """The grid was moved by `seconds`: the process stood still, or its clock jumped."""

    seconds: float
    clock_jump: bool

    def __str__(self) -> str:
        """Say it in words."""
        return (
            f"the clock jumped by {self.seconds:+.3f} s"
            if self.clock_jump
            else f"this process stood still for {self.seconds:.3f} s"
        )


def follow_at(priority: int) -> bool:
    """Let the thread that asks run right after a ticker of a real-time priority; return whether that is allowed.

    Threads of one Python wait for each other: one that other programs hold up holds up the ticker, too. Threads that it
    starts have no such priority.
    """
    if not hasattr(os, "sched_setscheduler"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(max(1, priority - 1)))
    except PermissionError:
        return False
    return True


def follow_no_more() -> None:
    """Give back what `follow_at` gave: the end of a process is in no hurry, and is to let its other threads finish."""
    if hasattr(os, "sched_setscheduler") and os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


class Ticker:
    """Tick k is due at t0 + k / rate: no error adds up, whatever a tick costs.

    late: `skip` leaves out ticks that are overdue by a whole interval and counts them (a command for the past is worth
    nothing); `catch_up` makes up for them (a simulation must not lose time). Lateness beyond `stall` seconds, or a
    clock that runs backwards, moves the whole grid instead and is told to `on_stall`. An exception in a tick ends the
    thread and is handed to `on_error`. With a `priority` above 0 the thread runs before all that has none (SCHED_FIFO
    of Linux, as ros2_control's update loop does): other programs don't make a tick late.
    """

    def __init__(
        self,
        rate: float,
        tick: Callable[[int], None],
        *,
        late: Literal["skip", "catch_up"] = "skip",
        stall: float = 0.1,
        on_stall: Callable[[Stall], None] | None = None,
        on_error: Callable[[BaseException], None] | None = None,
        clock: Callable[[], float] | None = None,
        priority: int = 0,
    ) -> None:
        """Prepare a grid of `rate` [Hz]; `clock` [s] replaces the machine's monotonic clock.

        priority: one that `follow_at` allows.
        """
        self.interval = 1.0 / rate
        self._tick = tick
        self._catch_up = late == "catch_up"
        self._stall = stall
        self._on_stall = on_stall
        self._on_error = on_error
        self._clock = clock or time.monotonic
        self._foreign = clock is not None
        self._priority = priority
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ticker", daemon=True)
        self._timing = Timing()
        self._due = 0.0
        self._woke = -float("inf")  # real time at which this process went on after standing still
        self._seen = 0.0, 0.0  # the foreign clock and the machine's, when they were last looked at

    @property
    def timing(self) -> Timing:
        """How well the grid was kept so far."""
        return self._timing

    @property
    def late(self) -> float:
        """How long ago the present tick was due [s], by the ticker's clock."""
        return self._clock() - self._due

    @property
    def running(self) -> bool:
        """Whether there are ticks to come."""
        return self._thread.is_alive() and not self._ended.is_set()

    def start(self) -> None:
        """Start the thread; its first tick is due at once."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread and wait for it, however long its last tick takes; a tick may call this for its own ticker."""
        self._ended.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()

    def _run(self) -> None:
        try:
            if self._priority:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(self._priority))
            self._loop()
        except Exception as error:  # noqa: BLE001 - any failure of a tick belongs to whoever owns the ticker
            if self._on_error is None:
                raise
            self._on_error(error)

    def _loop(self) -> None:
        while self._foreign and self._clock() <= 0.0:  # a clock that has not been heard yet
            if self._ended.wait(_POLL):
                return
        start, _ = self._seen = self._look()
        number = 0
        ticks = missed = stalls = 0
        worst = 0.0
        while not self._ended.is_set():
            stall = self._wait(start + number * self.interval)
            if self._ended.is_set():
                return
            late = self._clock() - start - number * self.interval
            if stall is None and late > self._stall:
                stall = Stall(late, clock_jump=False)
            if stall is not None:
                start += late
                stalls += 1
                if self._on_stall is not None:
                    self._on_stall(stall)
                late = 0.0
            elif late > self.interval and not self._catch_up:
                overdue = int(late / self.interval)
                missed += overdue
                number += overdue
            worst = max(worst, late)
            self._due = start + number * self.interval
            self._tick(number)
            number += 1
            ticks += 1
            self._timing = Timing(ticks, missed, worst, stalls)

    def _wait(self, deadline: float) -> Stall | None:
        """Wait until the deadline; return the jump of a foreign clock that happened since the last look at it."""
        if not self._foreign:
            self._ended.wait(max(deadline - self._clock(), 0.0))
            return None
        while True:
            before, real_before = self._seen
            now, real = self._look()
            if real - real_before > _STALE:
                # what it said before this process stood still is old; one that says nothing for so long stands still
                # itself, and may well wait for this process
                news = time.monotonic() + _NEWS
                while self._clock() == now and time.monotonic() < news and not self._ended.wait(_POLL):
                    pass
                self._woke = time.monotonic()
                now, real = self._look()
            self._seen = now, real
            step = now - before
            # what real time explains is this process standing still, not its clock; nor is what it hears on waking
            if step < 0.0 or step - (real - real_before) > self._stall:
                return Stall(step, clock_jump=step < 0.0 or real - self._woke > _STALE)
            if now >= deadline or self._ended.wait(_POLL):
                return None

    def _look(self) -> tuple[float, float]:
        """Return a foreign clock and the machine's of the same moment: no stop of this process lies between the two."""
        while True:
            begun, now, real = time.monotonic(), self._clock(), time.monotonic()
            if real - begun <= _STALE:
                return now, real
