"""Publishes joint states as a robot's driver does: efforts as its YAML declares them, on the topics that it names."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_ident.nodes.common import BaseNode, overridable, reliable
from robot_ident.nodes.effort_topics import KINDS, sources_of, topics_of
from robot_ident.nodes.joint_states import joint_state
from robot_ident.recording.effort import as_reported
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array


class ReportedStates:
    """The topic `joint_states`, and beside it those that hold efforts."""

    def __init__(self, node: BaseNode, robot: Robot, depth: int) -> None:
        """Make the publishers."""
        self._robot, sources = robot, sources_of(robot, node)
        self._places = {name: robot.joints.index(name) for name in sources}
        self._beside = {name: one for name, one in sources.items() if one.topic is None}
        self._named = {name: one for name, one in sources.items() if one.topic is not None and one.index is None}
        self._numbered = {name: one for name, one in sources.items() if one.topic is not None and one.index is not None}
        self._states = node.create_publisher(
            JointState, "joint_states", reliable(depth), qos_overriding_options=overridable()
        )
        self._others = {
            topic: node.create_publisher(KINDS[kind], topic, reliable(depth), qos_overriding_options=overridable())
            for topic, kind in topics_of(sources).items()
        }

    def publish(self, stamp_ns: int, q: Array, dq: Array, tau: Array) -> None:
        """Publish positions q [n] rad, velocities dq [n] and the torque tau [n] Nm at the joints, as reported."""
        reported = as_reported(tau[None], q[None], self._robot)[0]
        if not self._places:
            self._states.publish(joint_state(self._robot.joints, stamp_ns, q, dq, reported))
            return
        beside = reported.copy()
        beside[list(self._places.values())] = 0.0
        rates = dq.copy()
        for name in self._beside:
            rates[self._places[name]] = reported[self._places[name]]
        whole = len(self._places) == self._robot.n
        self._states.publish(joint_state(self._robot.joints, stamp_ns, q, rates, None if whole else beside))
        for topic, publisher in self._others.items():
            publisher.publish(self._message(topic, stamp_ns, reported))

    def _message(self, topic: str, stamp_ns: int, reported: Array) -> JointState | Float64MultiArray:
        named = {name: one.field for name, one in self._named.items() if one.topic == topic}
        if named:
            message = joint_state(tuple(named), stamp_ns)
            for field in set(named.values()):
                there = [float(reported[self._places[name]]) if own == field else np.nan for name, own in named.items()]
                setattr(message, field, there)
            return message
        indices = {name: one.index for name, one in self._numbered.items() if one.topic == topic}
        numbers = np.zeros(max(index for index in indices.values() if index is not None) + 1)
        for name, index in indices.items():
            numbers[index] = reported[self._places[name]]
        return Float64MultiArray(data=numbers.tolist())
