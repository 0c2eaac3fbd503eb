"""How a motion reaches the robot: sample by sample, or as trajectories for a joint_trajectory_controller."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_ident.excitation.reference import Reference
from robot_ident.motion import Motion
from robot_ident.nodes.common import BaseNode, overridable, reliable
from robot_ident.nodes.joint_states import duration_message, joint_state, time_message
from robot_ident.playing.player import Command, Phase, Player
from robot_ident.playing.windows import Windows

OUTPUTS = {
    "joint_state": "positions and velocities, sample by sample, on joint_command",
    "joint_trajectory": "trajectories that each end at rest, for the joint_trajectory_controller named by controller",
}


class Output(Protocol):
    """Sends what a player commands."""

    publisher: Publisher
    lead: float
    """How long before it takes effect a change of plan must be sent [s]."""
    longest_stall: float
    """After how long without a command no path leads on from the last one [s]."""

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send what is due at the player's time t [s]; stamp() [ns] is the instant on the node's clock."""


class SampleOutput:
    """One JointState a tick: position and velocity."""

    lead = 0.0
    longest_stall = np.inf

    def __init__(self, node: BaseNode, joints: Sequence[str], depth: int) -> None:
        """Publish on `joint_command`."""
        self._joints = tuple(joints)
        self.publisher = node.create_publisher(
            JointState, "joint_command", reliable(depth), qos_overriding_options=overridable()
        )

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send one sample."""
        if command is not None:
            self.publisher.publish(joint_state(self._joints, stamp(), command.q, command.dq))


class TrajectoryOutput:
    """The plan of the next moments and a stop after it, ten times a second and at every change of phase."""

    lead = 0.1
    every = 0.1  # s between two windows
    longest_stall = 0.2  # s; after more than that the controller may have begun to stop by itself

    def __init__(
        self,
        node: BaseNode,
        joints: Sequence[str],
        depth: int,
        controller: str,
        plan_stop: Callable[[Motion], Reference],
    ) -> None:
        """Publish on `CONTROLLER/joint_trajectory`."""
        self._joints = list(joints)
        self._windows = Windows(plan_stop, back=self.lead, ahead=self.lead + 3 * self.every)
        self._sent: tuple[Phase, float] = (Phase.IDLE, -np.inf)
        self.publisher = node.create_publisher(
            JointTrajectory,
            f"{controller.rstrip('/')}/joint_trajectory",
            reliable(depth),
            qos_overriding_options=overridable(),
        )

    def send(self, player: Player, command: Command | None, t: float, stamp: Callable[[], int]) -> None:
        """Send a window where one is due; a controller that holds needs none."""
        phase, last = self._sent
        changed = player.phase is not phase
        if not changed and (not player.moving or t - last < self.every):
            return
        self._sent = (player.phase, t)
        window = self._windows.around(player, t)
        if window is None:
            return
        message = JointTrajectory(joint_names=self._joints)
        message.header.stamp = time_message(stamp() + round(window.t[0] * 1e9))
        message.points = [
            JointTrajectoryPoint(
                positions=q.tolist(), velocities=dq.tolist(), accelerations=ddq.tolist(), time_from_start=since
            )
            for q, dq, ddq, since in zip(
                window.motion.q,
                window.motion.dq,
                window.motion.ddq,
                (duration_message(round(1e9 * s)) for s in window.t - window.t[0]),
                strict=True,
            )
        ]
        self.publisher.publish(message)
