"""How a motion reaches the robot: sample by sample, as trajectories for a joint_trajectory_controller, or as goals of
the action FollowJointTrajectory in a full ROS 2 installation.
"""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np
from rclpy.action import ActionClient
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_ident.errors import InputError
from robot_ident.nodes.messages import joint_state, trajectory
from robot_ident.nodes.node import BaseNode, overridable, reliable
from robot_ident.playback.player import Player
from robot_ident.playback.windows import Goals, WindowSchedule
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Reference

OUTPUTS = {
    "joint_state": "positions and velocities, sample by sample, on joint_command",
    "joint_trajectory": "trajectories that each end at rest, for the joint_trajectory_controller named by controller",
    "follow_joint_trajectory": "the same as goals of its action, which also tells that it gave up (needs control_msgs)",
}


_SETTLE = 3.0  # s for which the listeners must stay the same: a recorder may be found so long after the robot
_TRIGGER = "std_srvs/srv/Trigger"


class Output(ABC):
    """Sends what a player commands.

    lead [s]: how long before it takes effect a change of plan must be sent. every [s]: how far two commands may be
    apart. longest_stall [s]: after how long without a command no path leads on from the last one. longest_silence [s]:
    after how long without a word from the robot no command may reach it that it has missed until then.
    """

    lead: ClassVar[float]
    every: ClassVar[float]
    longest_stall: ClassVar[float]
    longest_silence: ClassVar[float]

    @abstractmethod
    def send(self, player: Player, command: Motion | None, t: float, stamp: Callable[[], int]) -> None:
        """Send what is due at the player's time t [s]; stamp() [ns] is the instant on the node's clock."""

    @abstractmethod
    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""

    def rival(self) -> str:
        """Return who else commands the robot, or an empty text."""
        return ""

    def simulated(self) -> bool:
        """Return whether what listens is a simulated robot of ours: it publishes the state and can be reset."""
        return False

    @abstractmethod
    def forget(self) -> None:
        """Forget what was sent and hasn't arrived: the robot must not hear of it later."""

    @abstractmethod
    def close(self) -> None:
        """Give back what it holds of the node."""


class _TopicOutput(Output):
    """What is published on a topic, reliably, to whoever listens there."""

    def __init__(self, node: BaseNode, joints: Sequence[str], kind: Any, topic: str, depth: int) -> None:
        self._node, self._joints = node, tuple(joints)
        self._lock = threading.Lock()
        self._made = partial(node.create_publisher, kind, topic, reliable(depth), qos_overriding_options=overridable())
        self._commands: Publisher = self._made()
        self._listeners = (0, 0.0)

    def _publish(self, message: Any) -> None:
        with self._lock:
            self._commands.publish(message)

    def forget(self) -> None:
        """Go on with a new publisher: the old one would deliver its last messages once a network is back."""
        with self._lock:
            old, self._commands = self._commands, self._made()  # whoever counts listeners meanwhile asks one there is
            self._node.destroy_publisher(old)

    def close(self) -> None:
        """Destroy the publisher."""
        with self._lock:
            self._node.destroy_publisher(self._commands)

    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""
        topic, matched = self._commands.topic_name, self._commands.get_subscription_count()
        if matched != self._listeners[0]:
            self._listeners = (matched, time.monotonic())
        if not matched or matched < len(self._node.get_subscriptions_info_by_topic(topic)):
            return f"nobody listens to {topic}"
        settled = time.monotonic() - self._listeners[1] > _SETTLE
        return "" if settled else f"the listeners on {topic} are still being found"

    def simulated(self) -> bool:
        """Return whether a node that listens publishes the robot's state and can be reset."""
        states = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name("joint_states"))
        listening = self._node.get_subscriptions_info_by_topic(self._commands.topic_name)
        named = ({(info.node_name, info.node_namespace) for info in infos} for infos in (states, listening))
        return any(
            (f"{namespace.rstrip('/')}/{name}/reset", [_TRIGGER])
            in self._node.get_service_names_and_types_by_node(name, namespace)
            for name, namespace in set.intersection(*named)
        )

    def rival(self) -> str:
        """Return who else publishes there, or an empty text."""
        topic, own = self._commands.topic_name, (self._node.get_namespace(), self._node.get_name())
        infos = self._node.get_publishers_info_by_topic(topic)
        if len(infos) < 2:
            return ""
        name = next((one.node_name for one in infos if (one.node_namespace, one.node_name) != own), own[1])
        return f"{name} publishes on {topic} as well"


class SampleOutput(_TopicOutput):
    """One JointState a tick: position and velocity."""

    lead = 0.0
    every = 0.05  # a robot takes samples further apart for steps
    longest_stall = longest_silence = np.inf

    def __init__(self, node: BaseNode, joints: Sequence[str], depth: int) -> None:
        """Publish on `joint_command`."""
        super().__init__(node, joints, JointState, "joint_command", depth)

    def send(self, player: Player, command: Motion | None, t: float, stamp: Callable[[], int]) -> None:
        """Send one sample."""
        if command is not None:
            self._publish(joint_state(self._joints, stamp(), command.q[0], command.dq[0]))


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

    def send(self, player: Player, command: Motion | None, t: float, stamp: Callable[[], int]) -> None:
        """Send a window where one is due."""
        meant = stamp()
        window = self._schedule.due(player, t, meant)
        if window is not None:
            self._publish(trajectory(self._joints, window, meant))


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


class ActionOutput(Output):
    """The plan of the next second and a stop after it, four times a second: each goal replaces the one before.

    One goal for all would let a controller play on for minutes after this process has died. What the action adds to
    the topic is the controller's answer: `on_trouble` is told when it rejects or aborts, or when somebody else has sent
    goals. No simulated robot of ours serves the action.
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

    def send(self, player: Player, command: Motion | None, t: float, stamp: Callable[[], int]) -> None:
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
            self._on_trouble("the controller rejected the trajectory")
            return
        handle.get_result_async().add_done_callback(lambda future: self._ended(number, future.result()))

    def _ended(self, number: int, answer: Any) -> None:
        trouble = self._goals.ended(number, answer.status, answer.result.error_code, answer.result.error_string)
        if trouble:
            self._on_trouble(trouble)

    def not_heard(self) -> str:
        """Return why the robot may not hear the commands yet, or an empty text."""
        return "" if self._client.server_is_ready() else f"nobody serves the action {self._name}"

    def forget(self) -> None:
        """Do nothing: a goal that was asked for can't be taken back."""

    def close(self) -> None:
        """Destroy the client."""
        self._client.destroy()
