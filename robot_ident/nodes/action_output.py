"""A motion as goals of the action FollowJointTrajectory, in a full ROS 2 installation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.action import ActionClient

from robot_ident.errors import InputError
from robot_ident.excitation.reference import Reference
from robot_ident.nodes.common import BaseNode
from robot_ident.nodes.joint_states import trajectory
from robot_ident.playing.goals import Goals
from robot_ident.playing.player import Command, Player
from robot_ident.playing.windows import WindowSchedule
from robot_ident.signals.motion import Motion


def follow_joint_trajectory() -> Any:
    """Return the type of the action; InputError where it isn't installed: no wheel has it."""
    try:
        from control_msgs.action import FollowJointTrajectory
    except ImportError as error:
        raise InputError(
            "parameter output = 'follow_joint_trajectory': control_msgs is missing; a full ROS 2 has it (apt install"
            " ros-jazzy-control-msgs), the wheels don't: output joint_trajectory drives the same controller without it"
        ) from error
    return FollowJointTrajectory


class ActionOutput:
    """The plan of the next second and a stop after it, four times a second: each goal replaces the one before.

    One goal for all would let a controller play on for minutes after this process has died. What the action adds to
    the topic is the controller's answer: `on_trouble` is told when it rejects or aborts.
    """

    lead = 0.2
    every = 0.25
    ahead = 0.95
    longest_stall = 0.5  # s; the plan reaches further than that
    longest_silence = 0.8

    def __init__(
        self,
        node: BaseNode,
        joints: Sequence[str],
        controller: str,
        plan_stop: Callable[[Motion], Reference],
        on_trouble: Callable[[str], None],
    ) -> None:
        """Become a client of `CONTROLLER/follow_joint_trajectory`."""
        self._type = follow_joint_trajectory()
        self._joints, self._on_trouble = tuple(joints), on_trouble
        self._schedule = WindowSchedule(
            plan_stop, node.now_ns, lead=self.lead, every=self.every, ahead=self.ahead, latest=self.longest_stall
        )
        self._goals = Goals()
        self._name = f"{controller.rstrip('/')}/follow_joint_trajectory"
        self._client = ActionClient(node, self._type, self._name)

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send a goal where one is due; the controller's own tolerances hold."""
        waited = self._goals.unanswered(t)
        if not player.moving:
            self._goals.forget()
        elif waited > self.longest_stall:  # it may have begun to stop by itself, and would leap onto a later goal
            player.halt(f"the controller has not answered a goal for {waited:.2f} s")
            return
        meant = stamp()
        window = self._schedule.due(player, t, meant)
        if window is None:
            return
        number = self._goals.next(t)
        goal = self._type.Goal(trajectory=trajectory(self._joints, window, meant))
        self._client.send_goal_async(goal).add_done_callback(lambda future: self._answered(number, future.result()))

    def _answered(self, number: int, handle: Any) -> None:
        self._goals.answered(number)
        if not handle.accepted:
            self._on_trouble(self._goals.rejected())
            return
        handle.get_result_async().add_done_callback(lambda future: self._ended(number, future.result()))

    def _ended(self, number: int, answer: Any) -> None:
        trouble = self._goals.ended(number, answer.status, answer.result.error_code, answer.result.error_string)
        if trouble:
            self._on_trouble(trouble)

    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""
        return "" if self._client.server_is_ready() else f"nobody serves the action {self._name}"

    def rival(self) -> str:
        """Return an empty text: who else has sent goals is told by the end of ours."""
        return ""

    def simulated(self) -> bool:
        """Return False: no simulated robot of ours serves the action."""
        return False

    def forget(self) -> None:
        """Do nothing: a goal that was asked for can't be taken back."""

    def close(self) -> None:
        """Destroy the client."""
        self._client.destroy()
