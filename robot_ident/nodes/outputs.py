"""How a motion reaches the robot: sample by sample, as trajectories for a joint_trajectory_controller, or as goals of
the action FollowJointTrajectory in a full ROS 2 installation.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from rclpy.action import ActionClient
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_ident.errors import InputError
from robot_ident.nodes.messages import joint_state, trajectory
from robot_ident.nodes.node import BaseNode, overridable, reliable
from robot_ident.nodes.peers import Neighbours
from robot_ident.playback.player import Command, Player
from robot_ident.playback.windows import Goals, WindowSchedule
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Reference

OUTPUTS = {
    "joint_state": "positions and velocities, sample by sample, on joint_command",
    "joint_trajectory": "trajectories that each end at rest, for the joint_trajectory_controller named by controller",
    "follow_joint_trajectory": "the same as goals of its action, which also tells that it gave up (needs control_msgs)",
}


class Output(Protocol):
    """Sends what a player commands."""

    lead: float
    """How long before it takes effect a change of plan must be sent [s]."""
    every: float
    """How far two commands may be apart [s]."""
    longest_stall: float
    """After how long without a command no path leads on from the last one [s]."""
    longest_silence: float
    """After how long without a word from the robot no command may reach it that it has missed until then [s]."""

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send what is due at the player's time t [s]; stamp() [ns] is the instant on the node's clock."""

    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""

    def rival(self) -> str:
        """Return who else commands the robot, or an empty text."""

    def simulated(self) -> bool:
        """Return whether what listens is a simulated robot of ours."""

    def forget(self) -> None:
        """Forget what was sent and hasn't arrived: the robot must not hear of it later."""

    def close(self) -> None:
        """Give back what it holds of the node."""


class Renewable:
    """A reliable publisher that can be renewed: it would deliver its last messages once a network is back."""

    def __init__(self, node: BaseNode, kind: Any, topic: str, depth: int) -> None:
        """Publish messages of a kind."""
        self._node, self._kind, self._topic, self._depth = node, kind, topic, depth
        self._lock = threading.Lock()
        self.now = self._made()

    def _made(self) -> Publisher:
        return self._node.create_publisher(
            self._kind, self._topic, reliable(self._depth), qos_overriding_options=overridable()
        )

    def publish(self, message: Any) -> None:
        """Send a message."""
        with self._lock:
            self.now.publish(message)

    def renew(self) -> None:
        """Go on with a new publisher, and without what the old one had still to deliver."""
        with self._lock:
            old, self.now = self.now, self._made()  # whoever counts listeners meanwhile asks one that is there
            self._node.destroy_publisher(old)

    def close(self) -> None:
        """Destroy it."""
        with self._lock:
            self._node.destroy_publisher(self.now)


class _TopicOutput:
    """What is published on a topic, to whoever listens there."""

    def __init__(self, node: BaseNode, joints: Sequence[str], kind: Any, topic: str, depth: int) -> None:
        self._joints = tuple(joints)
        self._commands = Renewable(node, kind, topic, depth)
        neighbours = Neighbours(node, lambda: self._commands.now)
        self.not_heard, self.rival, self.simulated = neighbours.not_heard, neighbours.rival, neighbours.simulated
        self.forget, self.close = self._commands.renew, self._commands.close


class SampleOutput(_TopicOutput):
    """One JointState a tick: position and velocity."""

    lead = 0.0
    every = 0.05  # a robot takes samples further apart for steps
    longest_stall = longest_silence = np.inf

    def __init__(self, node: BaseNode, joints: Sequence[str], depth: int) -> None:
        """Publish on `joint_command`."""
        super().__init__(node, joints, JointState, "joint_command", depth)

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send one sample."""
        if command is not None:
            self._commands.publish(joint_state(self._joints, stamp(), command.q, command.dq))


class TrajectoryOutput(_TopicOutput):
    """The plan of the next moments and a stop after it, twenty times a second and at every change of phase."""

    lead = 0.1
    every = 0.05  # s between two windows: a simulated robot's clock can wait for the next before a stop takes effect
    ahead = 0.4  # s of the plan in each of them
    longest_stall = 0.2  # s; after more than that the controller may have begun to stop by itself
    longest_silence = 0.3  # s; and 0.1 s more until what was sent is taken back

    def __init__(
        self,
        node: BaseNode,
        joints: Sequence[str],
        depth: int,
        controller: str,
        plan_stop: Callable[[Motion], Reference],
    ) -> None:
        """Publish on `CONTROLLER/joint_trajectory`."""
        super().__init__(node, joints, JointTrajectory, f"{controller.rstrip('/')}/joint_trajectory", depth)
        self._schedule = WindowSchedule(
            plan_stop, node.now_ns, lead=self.lead, every=self.every, ahead=self.ahead, latest=self.longest_stall
        )

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send a window where one is due."""
        meant = stamp()
        window = self._schedule.due(player, t, meant)
        if window is not None:
            self._commands.publish(trajectory(self._joints, window, meant))


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
