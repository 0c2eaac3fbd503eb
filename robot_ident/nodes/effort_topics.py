"""Listens where a robot's YAML says that efforts stand, when that is not beside the positions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_ident.bags import JOINT_STATE, NUMBERS
from robot_ident.errors import InputError
from robot_ident.nodes.messages import stamp_of
from robot_ident.nodes.node import BaseNode, offered
from robot_ident.nodes.subscriptions import Hearing
from robot_ident.robot import Robot
from robot_ident.robot.drives import EffortSource

KINDS = {JOINT_STATE: JointState, NUMBERS: Float64MultiArray}
"""The types of message that hold efforts."""
_LOOK = 0.2  # s between looks for who publishes


@dataclass(frozen=True)
class EffortMessage:
    """One message: stamp [ns] (0 where it has none), when it came [ns], the efforts of joints as reported, its bytes.

    positions: whether it holds the positions of the robot's joints as well.
    """

    topic: str
    stamp_ns: int
    received_ns: int
    values: Mapping[str, float]
    data: bytes
    positions: bool


def sources_of(robot: Robot, node: BaseNode, states: str = "joint_states") -> dict[str, EffortSource]:
    """Return where efforts stand that are not in the field `effort` beside the positions of topic `states`, by joint.

    Without a topic: in another field of the messages of `states`. InputError where these can't hold it.
    """
    declared = robot.effort.topic
    sources = dict(robot.effort.sources)
    if declared is not None and not _same(node, declared, states):
        sources = {joint: sources.get(joint, EffortSource(declared)) for joint in robot.joints}
    out = {}
    for joint, source in sources.items():
        if joint not in robot.joints:
            continue
        beside = source.topic is None or _same(node, source.topic, states)
        if beside and source.index is not None or beside and source.field == "position":
            raise InputError(
                f"robot {robot.name}: effort of {joint}: field {source.field} can't stand in {states}, the topic of the"
                " positions"
            )
        if beside and source.field == "effort":
            continue
        out[joint] = replace(source, topic=None) if beside else source
    return out


def topics_of(sources: Mapping[str, EffortSource]) -> dict[str, str]:
    """Return the topics of sources with their message types."""
    return {one.topic: JOINT_STATE if one.index is None else NUMBERS for one in sources.values() if one.topic}


def _same(node: BaseNode, one: str, other: str) -> bool:
    return bool(node.resolve_topic_name(one) == node.resolve_topic_name(other))


@dataclass
class _Heard:
    """What was heard of one topic: when last [s, monotonic], and which joint its last message lacked."""

    last: float = field(default_factory=time.monotonic)
    ever: bool = False
    lacks: str = ""


class EffortTopics:
    """Subscribes to each topic once somebody publishes there, with the quality of service that is offered."""

    def __init__(
        self,
        node: BaseNode,
        robot: Robot,
        sources: Mapping[str, EffortSource],
        take: Callable[[EffortMessage], None],
        depth: int,
    ) -> None:
        """Hand every message on topics of `sources` to `take`."""
        self._node, self._joints, self._take, self._depth = node, robot.joints, take, depth
        self._sources = {joint: source for joint, source in sources.items() if source.topic}
        self._kinds = topics_of(self._sources)
        self._heard = {topic: _Heard() for topic in self._kinds}
        self._hearings: dict[str, Hearing] = {}
        self._timer = node.every(_LOOK, self._look) if self._kinds else None
        self._look()

    def _look(self) -> None:
        """Subscribe where publishers of the right type have come."""
        for topic in set(self._kinds) - set(self._hearings):
            offers = [one for one in self._offers(topic) if one.topic_type == self._kinds[topic]]
            if offers:
                take, profile = partial(self._receive, topic), offered(offers, self._depth)
                self._hearings[topic] = Hearing(
                    self._node, KINDS[self._kinds[topic]], topic, profile, take=take, raw=True
                )

    def _offers(self, topic: str) -> list[Any]:
        return list(self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(topic)))

    def close(self) -> None:
        """Listen no more, for good."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        for hearing in self._hearings.values():
            hearing.end()

    def _receive(self, topic: str, data: bytes, info: Mapping[str, Any]) -> None:
        received = info["received_timestamp"] or time.time_ns()
        message = deserialize_message(data, KINDS[self._kinds[topic]])
        places = {joint: source for joint, source in self._sources.items() if source.topic == topic}
        values = {joint: _value(message, joint, source) for joint, source in places.items()}
        there = {joint: value for joint, value in values.items() if value is not None}
        heard = self._heard[topic]
        heard.lacks = next((joint for joint in values if joint not in there), "")
        if there:
            heard.last, heard.ever = time.monotonic(), True
        stamp = stamp_of(message) if isinstance(message, JointState) else 0
        named = isinstance(message, JointState) and len(message.position) == len(message.name)
        positions = named and set(self._joints) <= set(message.name)
        self._take(EffortMessage(topic, stamp, received, there, data, positions))

    def silent(self, after: float) -> str:
        """Return which topics have told no efforts for `after` [s] and why, or an empty text."""
        now = time.monotonic()
        return "; ".join(
            self._why(topic, heard, now - heard.last)
            for topic, heard in self._heard.items()
            if now - heard.last > after
        )

    def _why(self, topic: str, heard: _Heard, since: float) -> str:
        name, kind = self._node.resolve_topic_name(topic), self._kinds[topic]
        joints = ", ".join(joint for joint, source in self._sources.items() if source.topic == topic)
        head = f"no effort of {joints} on {name} " + (f"for {since:.1f} s" if heard.ever else "yet")
        offers = self._offers(topic)
        if heard.lacks and not heard.ever:
            place = self._sources[heard.lacks].field
            return f"{head}: its messages hold none of {heard.lacks} in field {place} (the YAML's effort.field)"
        if not offers:
            return f"{head}: nobody publishes there (the YAML's effort.topic)"
        if topic not in self._hearings:
            return f"{head}: it carries {offers[0].topic_type}, not {kind} (the YAML's effort.field)"
        return f"{head}: its publisher says nothing"


def _value(message: JointState | Float64MultiArray, joint: str, source: EffortSource) -> float | None:
    """Return the effort of a joint, None where the message has none."""
    if source.index is not None:
        return float(message.data[source.index]) if source.index < len(message.data) else None
    values = getattr(message, source.field)
    if joint not in message.name or len(values) != len(message.name):
        return None
    value = float(values[list(message.name).index(joint)])
    return None if math.isnan(value) else value
