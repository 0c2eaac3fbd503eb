"""What a controller answers to a row of goals, each of which replaces the one before."""

from __future__ import annotations

import threading
from enum import IntEnum


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

    def rejected(self) -> str:
        """Return what a rejected goal means."""
        return "the controller rejected the trajectory"

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
