"""The phases of a motion that is played on a robot, and the safe ways out of each."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from robot_ident.excitation.reference import Reference
from robot_ident.motion import Array, Motion
from robot_ident.playing.watch import Watch

_WINDOW = 0.15  # s of commands against which the robot's position is judged
_DWELL = 0.2  # s of rest between approach and motion, so that the robot has arrived


class Phase(Enum):
    """What the player is doing."""

    IDLE = "idle"  # nothing commanded yet
    PREPARING = "preparing"  # waits for the robot's state and plans the approach
    APPROACH = "approaching"
    PLAYING = "playing"
    STOPPING = "stopping"
    HOLDING = "holding"  # the last position is commanded again and again
    HALTED = "halted"  # nothing is commanded any more: the robot's own controller must hold


MOVING = (Phase.APPROACH, Phase.PLAYING, Phase.STOPPING)


@dataclass(frozen=True)
class Command:
    """What the robot is asked to do now: q, dq, ddq [n]."""

    q: Array
    dq: Array
    ddq: Array


@dataclass(frozen=True)
class Segment:
    """A reference that began at `begin` [s] of the player's time."""

    motion: Reference
    begin: float

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.begin + self.motion.duration

    def at(self, t: float) -> Motion:
        """Return the motion [1, n] at the player's time t, at rest at either end."""
        return self.motion.reference(np.array([min(max(t - self.begin, 0.0), self.motion.duration)]))


class Player:
    """Plays one motion: approach from where the robot stands, the motion, hold; a smooth stop from anywhere.

    plan_approach(q) gives the way from rest at q [n] to the start of the motion; plan_stop(motion [1, n]) the way from
    that state to rest. Position and velocity of the commands never step: each phase begins in the state in which the
    one before ends, at the same instant. `tick` is called by one thread, everything else by any.
    """

    def __init__(
        self,
        motion: Reference,
        plan_approach: Callable[[Array], Reference],
        plan_stop: Callable[[Motion], Reference],
        watch: Watch,
    ) -> None:
        """Prepare to play `motion`; the robot isn't moved before `start` and `prepare`."""
        self.motion = motion
        self.watch = watch
        self.reason = ""
        self.fault = False
        self.completed = 0
        self._plan_approach = plan_approach
        self._plan_stop = plan_stop
        self._lock = threading.RLock()
        self._phase = Phase.IDLE
        self._segment: Segment | None = None
        self._waiting: Reference | None = None
        self._stop_reason: tuple[str, bool] | None = None
        self._hold: Array | None = None
        self._recent: deque[tuple[float, Array]] = deque()
        self._t = 0.0

    @property
    def phase(self) -> Phase:
        """What is being done."""
        return self._phase

    @property
    def moving(self) -> bool:
        """Whether the robot is being moved."""
        return self._phase in MOVING

    @property
    def elapsed(self) -> float:
        """Time in the present phase [s]."""
        with self._lock:
            return max(self._t - self._segment.begin, 0.0) if self._segment else 0.0

    def start(self) -> str:
        """Ask for the motion; return why it can't be played now, or an empty text. `prepare` must follow."""
        with self._lock:
            if self._phase not in (Phase.IDLE, Phase.HOLDING, Phase.HALTED):
                return f"already {self._phase.value}"
            if self._phase is Phase.HALTED:
                self._phase, self._hold = Phase.IDLE, None
            self._change(Phase.PREPARING)
            self.reason, self.fault, self._stop_reason = "", False, None
            self.watch.clear()
            return ""

    def prepare(self) -> None:
        """Plan the approach from where the robot stands; it begins at the next tick. What planning raises passes."""
        state = self.watch.state
        with self._lock:
            origin = self._hold if self._hold is not None else (None if state is None else state.q)
        if origin is None:
            raise RuntimeError("the robot's state must be known before an approach is planned")
        try:
            approach = self._plan_approach(origin)
        except Exception:
            self.cancel()
            raise
        with self._lock:
            if self._phase is Phase.PREPARING:
                self._waiting = approach

    def cancel(self) -> None:
        """Give up a start that has not moved the robot yet."""
        with self._lock:
            self._waiting = None
            if self._phase is Phase.PREPARING:
                self._change(Phase.IDLE if self._hold is None else Phase.HOLDING)

    def stop(self, reason: str, *, fault: bool = False) -> None:
        """Ask for a smooth stop; nothing happens where nothing moves."""
        with self._lock:
            self.cancel()
            if self._phase in (Phase.APPROACH, Phase.PLAYING) and self._stop_reason is None:
                self._stop_reason = (reason, fault)

    def halt(self, reason: str) -> None:
        """Command nothing any more: after so long without commands no path leads on from the last one."""
        with self._lock:
            self.cancel()
            if self._phase in (*MOVING, Phase.HOLDING):
                self.reason, self.fault = reason, True
                self._segment, self._stop_reason, self._hold = None, None, None
                self._change(Phase.HALTED)

    def tick(self, t: float, now: float) -> Command | None:
        """Return the command at the player's time t [s]; `now` [s] is the time at which states are received."""
        with self._lock:
            self._t = t
            if self._waiting is not None:
                self._segment, self._waiting = Segment(self._waiting, t), None
                self._change(Phase.APPROACH)
            if self._phase in (Phase.APPROACH, Phase.PLAYING):
                self._advance(t)
            if self._phase in (Phase.APPROACH, Phase.PLAYING):
                self._look(t, now)
            if self._phase is Phase.STOPPING and self._segment is not None and t >= self._segment.end:
                self._rest(self._segment)
            return self._command(t)

    def _advance(self, t: float) -> None:
        """Move on to the next phase where the present one has ended."""
        segment = self._segment
        if segment is None:
            return
        if self._phase is Phase.APPROACH and t >= segment.end + _DWELL:
            self._segment = Segment(self.motion, segment.end + _DWELL)
            self._change(Phase.PLAYING)
        elif self._phase is Phase.PLAYING and t >= segment.end:
            self.completed += 1
            self._rest(segment)

    def _look(self, t: float, now: float) -> None:
        """Begin a smooth stop where it was asked for or the robot is not well."""
        window = np.array([q for _, q in self._recent])
        problem = self.watch.problem(now, window)
        if problem:
            self._stop_reason = (problem, True)
        if self._stop_reason is None or self._segment is None:
            return
        self.reason, self.fault = self._stop_reason
        self._stop_reason = None
        self._segment = Segment(self._plan_stop(self._segment.at(t)), t)
        self._change(Phase.STOPPING)

    def _rest(self, segment: Segment) -> None:
        self._hold = segment.at(segment.end).q[0]
        self._segment = None
        self._change(Phase.HOLDING)

    def _change(self, phase: Phase) -> None:
        self._phase = phase

    def _command(self, t: float) -> Command | None:
        if self._segment is not None:
            motion = self._segment.at(t)
            command = Command(motion.q[0], motion.dq[0], motion.ddq[0])
        elif self._hold is not None:
            still = np.zeros_like(self._hold)
            command = Command(self._hold, still, still)
        else:
            return None
        self._recent.append((t, command.q))
        while self._recent[0][0] < t - _WINDOW:
            self._recent.popleft()
        return command
