"""The phases of a motion that is played on a robot, and the safe ways out of each."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise

import numpy as np

from robot_ident.playback.supervisor import Watch
from robot_ident.signals.motion import Array, Motion, joined
from robot_ident.trajectories.excitation import Reference

_WINDOW = 0.15  # s of commands against which the robot's position is judged
_SAME = 1e-6  # rad or m between the end of a motion and the start of the next
DWELL = 0.2  # s of rest between one motion and the next, so that the robot has arrived


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
class Segment:
    """A reference that begins at `begin` [s] of the player's time; `number` counts the motions that are played."""

    motion: Reference
    begin: float
    phase: Phase
    number: int = -1

    @property
    def end(self) -> float:
        """When it ends [s]."""
        return self.begin + self.motion.duration

    def at(self, t: Array) -> Motion:
        """Return the motion [N, n] at the player's times t [N], at rest at either end."""
        return self.motion.reference(np.clip(t - self.begin, 0.0, self.motion.duration))


def end_of(motion: Reference) -> Array:
    """Return the position [n] at which a motion ends."""
    return motion.reference(np.array([motion.duration])).q[0]


class Player:
    """Plays a motion: approach from where the robot stands, rehearsals, the motion, hold; a smooth stop from anywhere.

    plan_approach(q) gives the way from rest at q [n] to the start of the motion; plan_stop(motion [1, n]) the way from
    that state to rest. rehearsals: motions that begin and end where the motion does; after each of them judge(number)
    says why the next may not follow, or nothing. lead [s]: how long before it diverges from the plan a stop is decided,
    for controllers that are sent the plan ahead. hindrance() says why the robot may not begin to move now, or nothing:
    it is asked at the instant of the first command, and the start waits on. dwell [s]: how long it rests before each
    motion, the approach as well: a controller hears of it long before it moves. Position and velocity of the commands
    never step: each segment begins in the state in which the one before ends, at the same instant. longest_step [n]:
    commands further apart than this and the bound on tracking, where ticks were left out, are not sent. Where a motion
    has ended its last position is commanded on, as long as the robot is seen to be there. `tick` is called by one
    thread, everything else by any.
    """

    def __init__(
        self,
        motion: Reference,
        plan_approach: Callable[[Array], Reference],
        plan_stop: Callable[[Motion], Reference],
        watch: Watch,
        *,
        rehearsals: Sequence[Reference] = (),
        judge: Callable[[int], str] = lambda number: "",
        hindrance: Callable[[], str] = lambda: "",
        lead: float = 0.0,
        dwell: float = DWELL,
        longest_step: Array | float = np.inf,
    ) -> None:
        """Prepare to play `motion`; the robot isn't moved before `start` and `prepare`.

        Raises ValueError where a rehearsal ends elsewhere than the next motion begins.
        """
        self.motions = (*rehearsals, motion)
        for number, (one, following) in enumerate(pairwise(self.motions)):
            if np.abs(end_of(one) - following.start_pose).max() > _SAME:
                raise ValueError(f"motion {number} ends elsewhere than motion {number + 1} begins")
        self.watch = watch
        self.reason = ""
        self.fault = False
        self.completed = 0
        self._plan_approach = plan_approach
        self._plan_stop = plan_stop
        self._judge = judge
        self._hindrance = hindrance
        self._lead = lead
        self._dwell = dwell
        self._longest_step = longest_step
        self._lock = threading.RLock()
        self._phase = Phase.IDLE
        self._plan: tuple[Segment, ...] = ()
        self._judged = 0
        self._waiting: Reference | None = None
        self._halts = 0
        self._stop_reason: tuple[str, bool] | None = None
        self._hold: Array | None = None
        self._recent: deque[tuple[float, Array]] = deque()
        self._played: Segment | None = None
        self._t = 0.0

    @property
    def phase(self) -> Phase:
        """What is being done."""
        return self._phase

    @property
    def state(self) -> tuple[Phase, str, bool]:
        """What is being done, why, and whether a fault is the cause; between two ticks, not within one."""
        with self._lock:
            return self._phase, self.reason, self.fault

    @property
    def moving(self) -> bool:
        """Whether the robot is being moved."""
        return self._phase in MOVING

    @property
    def elapsed(self) -> float:
        """Time in the present segment [s]."""
        with self._lock:
            return max(self._t - self._active(self._t).begin, 0.0) if self._plan else 0.0

    @property
    def number(self) -> int:
        """Which of `motions` is played; -1 in an approach."""
        with self._lock:
            return self._active(self._t).number if self._plan else -1

    @property
    def stop_duration(self) -> float:
        """How long the stop under way takes in all [s]; 0 where there is none."""
        with self._lock:
            return self._lead + self._plan[-1].motion.duration if self._phase is Phase.STOPPING else 0.0

    def start(self) -> str:
        """Ask for the motion; return why it can't be played now, or an empty text. `prepare` must follow."""
        with self._lock:
            if self._phase not in (Phase.IDLE, Phase.HOLDING, Phase.HALTED):
                return f"already {self._phase.value}"
            if self._phase is Phase.HALTED:
                self._hold = None
            self._phase = Phase.PREPARING
            self.reason, self.fault, self._stop_reason = "", False, None
            self.watch.clear()
            return ""

    def prepare(self) -> None:
        """Plan the approach from where the robot stands; it begins at the next tick, if the robot is still there then.

        Nothing is planned for a robot that nothing is known of (`unplanned` remains). What planning raises passes.
        """
        state = self.watch.state
        with self._lock:
            halts = self._halts
            origin = self._hold if self._hold is not None else (None if state is None else state.q)
        if origin is None:
            return
        try:
            approach = self._plan_approach(origin)
        except Exception:  # whatever went wrong, the start is given up before it passes on
            self.cancel()
            raise
        with self._lock:
            if self._phase is Phase.PREPARING and self._halts == halts:
                self._waiting = approach

    @property
    def unplanned(self) -> bool:
        """Whether a start waits for `prepare`."""
        with self._lock:
            return self._phase is Phase.PREPARING and self._waiting is None

    def cancel(self) -> None:
        """Give up a start that has not moved the robot yet."""
        with self._lock:
            self._waiting = None
            if self._phase is Phase.PREPARING:
                self._phase = Phase.IDLE if self._hold is None else Phase.HOLDING

    def stop(self, reason: str, *, fault: bool = False) -> None:
        """Ask for a smooth stop, or give up a start; nothing happens where nothing moves."""
        with self._lock:
            if self._phase is Phase.PREPARING:
                self.reason, self.fault = reason, fault
            self.cancel()
            if self._phase in (Phase.APPROACH, Phase.PLAYING) and self._stop_reason is None:
                self._stop_reason = (reason, fault)

    def interrupt(self, reason: str) -> None:
        """Stop smoothly, as a fault, where the robot is being moved; a start that has commanded nothing yet goes on."""
        with self._lock:
            if self._phase is not Phase.PREPARING:
                self.stop(reason, fault=True)

    def halt(self, reason: str) -> None:
        """Command nothing any more: after so long without commands no path leads on from the last one.

        A start that has commanded nothing yet goes on, but its approach must be planned anew (`unplanned`).
        """
        with self._lock:
            self._halts += 1
            self._waiting = None
            if self._hold is not None:
                self.cancel()
            if self._phase in (*MOVING, Phase.HOLDING):
                self.reason, self.fault = reason, True
                self._release()

    def tick(self, t: float, now: float) -> Motion | None:
        """Return what is commanded [1, n] at the player's time t [s]; `now` [s] is when states are received."""
        with self._lock:
            self._t = t
            if self._hold is not None and not self._plan:  # since an earlier tick: it is sent at least once
                self._look_at_rest(now)
            if self._waiting is not None:
                self._begin(self._waiting, t, now)
            if self._plan:
                self._advance(t)
            if self._phase in (Phase.APPROACH, Phase.PLAYING):
                self._look(t, now)
            return self._command(t)

    def ahead(self, t: Array) -> Motion | None:
        """Return what will be commanded at the player's times t [N] if nothing intervenes, None where nothing is."""
        with self._lock:
            if not self._plan:
                if self._hold is None:
                    return None
                still = np.zeros((len(t), len(self._hold)))
                return Motion(still + self._hold, still, still)
            begins = np.array([segment.begin for segment in self._plan])
            at = np.maximum(np.searchsorted(begins, t, side="right") - 1, 0)
            return joined([self._plan[k].at(t[at == k]) for k in np.unique(at)])

    def _begin(self, approach: Reference, t: float, now: float) -> None:
        """Take the way that was planned; where the robot is hindered or elsewhere now, it is planned anew."""
        self._waiting = None
        state = self.watch.state
        if self.watch.not_ready(now) or state is None or self._hindrance():
            return
        if np.any(np.abs(state.q - approach.start_pose) > self.watch.bounds.tracking):
            return
        plan = [Segment(approach, t + self._dwell, Phase.APPROACH)]
        for number, motion in enumerate(self.motions):  # with a rest between any two
            plan.append(Segment(motion, plan[-1].end + self._dwell, Phase.PLAYING, number))
        self._plan, self._judged, self._phase = tuple(plan), 0, Phase.APPROACH

    def _active(self, t: float) -> Segment:
        """Return the segment that rules at t: the last that has begun."""
        return next((segment for segment in reversed(self._plan) if segment.begin <= t), self._plan[0])

    def _advance(self, t: float) -> None:
        """Move on along the plan; after a rehearsal ask whether the next motion may follow."""
        last = self._plan[-1]
        if t >= last.end:
            self.completed += self._phase is Phase.PLAYING
            self._hold = last.at(np.array([last.end])).q[0]
            self._plan, self._phase = (), Phase.HOLDING
            return
        if self._phase is Phase.STOPPING:
            return
        for rehearsal in self._plan[1:-1]:  # whatever ticks were left out
            if rehearsal.number == self._judged and t >= rehearsal.end:
                self._judged += 1
                problem = self._judge(rehearsal.number)
                if problem and self._stop_reason is None:
                    self._stop_reason = (problem, True)
        active = self._active(t)
        if active is not self._played:
            self._played = active
            self.watch.measure_anew()
        self._phase = active.phase

    def _look_at_rest(self, now: float) -> None:
        """Command nothing more to a robot that is silent or elsewhere: it would leap once it heard the commands again.

        Its controller holds it meanwhile, wherever it is; the next start begins from there.
        """
        problem = self.watch.astray(now, self._window)
        if problem:
            if not self.fault:
                self.reason, self.fault = problem, True
            self._release()

    def _release(self) -> None:
        """Command nothing any more."""
        self._plan, self._stop_reason, self._hold, self._waiting = (), None, None, None
        self._recent.clear()
        self._phase = Phase.HALTED

    @property
    def _window(self) -> Array:
        """What was commanded lately [k, n]."""
        return np.array([q for _, q in self._recent])

    def _look(self, t: float, now: float) -> None:
        """Begin a smooth stop where it was asked for or the robot is not well.

        Where nothing is heard of a robot whose controller is told the plan ahead, that may hear nothing either: it
        comes to rest by itself at the end of what it was told, and would leap onto another stop that it heard of late.
        """
        silence = self.watch.silence(now) if self._lead else ""
        if silence:
            self.halt(f"{silence}; the controller stops by itself")
            return
        problem = self.watch.problem(now, self._window)
        if problem:
            self._stop_reason = (problem, True)
        if self._stop_reason is None:
            return
        self.reason, self.fault = self._stop_reason
        self._stop_reason = None
        begin = t + self._lead
        state = self.ahead(np.array([begin]))
        if state is not None:
            earlier = tuple(segment for segment in self._plan if segment.begin <= begin)
            self._plan = (*earlier, Segment(self._plan_stop(state), begin, Phase.STOPPING))
            self._phase = Phase.STOPPING

    def _command(self, t: float) -> Motion | None:
        command = self.ahead(np.array([t]))
        if command is None:
            return None
        if self._recent:
            step = np.abs(command.q[0] - self._recent[-1][1])
            over = step - np.maximum(self._longest_step, self.watch.bounds.tracking)
            if np.any(over > 0.0):
                joint = int(np.argmax(over))
                self.halt(f"{self.watch.joints[joint]} would leap by {step[joint]:.3f}: this process was held up")
                return None
        self._recent.append((t, command.q[0]))
        while self._recent[0][0] < t - _WINDOW - self._lead:
            self._recent.popleft()
        return command
