"""Cuts a motion into short trajectories that each end at rest, for controllers that are sent points ahead of time, and
reads what they answer to a row of goals, each of which replaces the one before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from robot_ident.playback.player import Phase, Player
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Reference

_IN_TIME = 0.8  # of the lead of a stop may have passed when it is sent
_SPACING = 0.02  # s between the points of a window


@dataclass(frozen=True)
class Window:
    """A trajectory: instants t [K] s, counted from the present, and the motion [K, n], at rest at the end."""

    t: Array
    motion: Motion


class WindowSchedule:
    """When a window is due and what it holds: twenty times a second, say, and at every change of phase.

    A window is the plan from `lead` seconds ago to `ahead` seconds from now, and a stop from there. A controller that
    hears nothing more brings the robot to rest by itself, within its limits, wherever the plan was. The points of the
    past make a controller go on along the plan when it takes a window in, rather than draw a line from where the robot
    is to the window's first point.
    """

    def __init__(
        self,
        plan_stop: Callable[[Motion], Reference],
        now_ns: Callable[[], int],
        *,
        lead: float,
        every: float,
        ahead: float,
        latest: float,
    ) -> None:
        """Reach `lead` [s] back and `ahead` [s] on, `every` [s] anew; now_ns() is the clock that stamps are of.

        latest [s]: later than that the controller may have begun to stop by itself, and would leap back onto the plan.
        """
        self._plan_stop, self._now_ns = plan_stop, now_ns
        self._lead, self._every, self._latest = lead, every, latest
        self._grid: Array = _SPACING * np.arange(-round(lead / _SPACING), round(ahead / _SPACING) + 1.0)
        self._sent: tuple[Phase, float] = (Phase.IDLE, -np.inf)

    def due(self, player: Player, t: float, stamp: int) -> Window | None:
        """Return the window that is to be sent at the player's time t [s]; a controller that holds needs none.

        stamp [ns]: the instant that t is meant to be. A controller that hears of a stop after it has begun would leap:
        such a one isn't sent, and that at the end of the last window takes place. Nor is any other that comes so late,
        or for an instant so far ahead, that the clock must have been set.
        """
        phase, last = self._sent
        changed = player.phase is not phase
        if not player.moving or (not changed and t - last < self._every):
            self._sent = (player.phase, last)
            return None
        self._sent = (player.phase, t)
        window = self._around(player, t)
        late = 1e-9 * (self._now_ns() - stamp)
        if player.phase is Phase.STOPPING and changed and late > _IN_TIME * self._lead:
            player.halt(f"{player.reason}; a stop came {late:.3f} s late: the controller stops by itself")
            return None
        if abs(late) > self._latest:
            player.halt(f"commands came {late:+.3f} s late: the controller stops by itself")
            return None
        return window

    def _around(self, player: Player, t: float) -> Window | None:
        """Return the window about the player's time t [s], None where nothing is commanded."""
        planned = player.ahead(t + self._grid)
        if planned is None:
            return None
        if not planned.dq[-1].any():
            return Window(self._grid, planned)
        stop = self._plan_stop(planned[-1:])
        count = max(1, int(np.ceil(stop.duration / _SPACING)))
        after: Array = stop.duration / count * np.arange(1.0, count + 1.0)
        braking = stop.reference(after)
        q, dq, ddq = (np.vstack([getattr(planned, name), getattr(braking, name)]) for name in ("q", "dq", "ddq"))
        dq[-1], ddq[-1] = 0.0, 0.0  # exactly, not but for rounding: a controller refuses an end that moves
        return Window(np.concatenate([self._grid, self._grid[-1] + after]), Motion(q, dq, ddq))


class GoalStatus(IntEnum):
    """How a goal of an action ended (action_msgs/msg/GoalStatus)."""

    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


class FollowError(IntEnum):
    """Why it did (control_msgs/action/FollowJointTrajectory, result)."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class Goals:
    """Numbers the goals and tells trouble from what happens to every goal that is replaced by the next.

    A replaced goal ends as canceled, or with INVALID_GOAL: that is how a joint_trajectory_controller gives it up. A
    rejected goal, a goal that was aborted for another reason, and the end of the latest one by somebody else's hand
    are trouble: the robot doesn't do what is planned any more. Several threads may call.
    """

    def __init__(self) -> None:
        """No goal has been sent."""
        self._lock = threading.Lock()
        self._latest = 0
        self._asked: dict[int, float] = {}

    def next(self, t: float) -> int:
        """Return the number of a new goal, the latest from now on; t [s]: when it is sent."""
        with self._lock:
            self._latest += 1
            self._asked[self._latest] = t
            return self._latest

    def answered(self, number: int) -> None:
        """Take note that the controller has accepted or rejected a goal."""
        with self._lock:
            self._asked.pop(number, None)

    def unanswered(self, t: float) -> float:
        """Return how long an answer has been waited for at t [s]."""
        with self._lock:
            return t - min(self._asked.values(), default=t)

    def forget(self) -> None:
        """Wait for no answer any more."""
        with self._lock:
            self._asked.clear()

    def ended(self, number: int, status: int, error: int, text: str = "") -> str:
        """Return what is wrong with the end of a goal, or an empty text; error and text are its result's."""
        with self._lock:
            replaced = number != self._latest
        given_up = status == GoalStatus.CANCELED or error == FollowError.INVALID_GOAL
        if status == GoalStatus.SUCCEEDED or (replaced and given_up):
            return ""
        names = {int(one): one.name for one in FollowError}
        why = text or (names.get(error, f"error {error}") if error else "no reason was given")
        return f"the controller {'canceled' if status == GoalStatus.CANCELED else 'aborted'} the trajectory: {why}"
