"""Takes joint states in as they come from DDS, with their efforts from wherever the robot's YAML has them, keeps the
latest, and makes a recording of them as the offline reader does.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from robot_ident.bags import JOINT_STATE, Topic
from robot_ident.bags.joint_states import JointStateDecoder, assemble
from robot_ident.bags.read import with_efforts
from robot_ident.bags.storage import Batch
from robot_ident.errors import InputError
from robot_ident.nodes.effort_topics import EffortMessage, EffortTopics, sources_of, topics_of
from robot_ident.nodes.messages import columns, stamp_of
from robot_ident.nodes.node import BaseNode, reliable
from robot_ident.nodes.subscriptions import Hearing
from robot_ident.playback.stamps import Paired, Pairing
from robot_ident.recording.recording import Recording
from robot_ident.robot import Robot
from robot_ident.robot.drives import EffortSource
from robot_ident.signals.motion import Array

Message = tuple[int, int, bytes]
"""One message: stamp [ns], received [ns], serialized."""


class Collector:
    """Serialized messages of one topic of the last `memory` [s], by their stamps."""

    def __init__(self, memory: float) -> None:
        """Keep `memory` [s]."""
        self.memory_ns = round(memory * 1e9)
        self.received = 0
        self._messages: deque[Message] = deque()

    def __len__(self) -> int:
        """Return the number of messages kept."""
        return len(self._messages)

    def add(self, stamp_ns: int, received_ns: int, data: bytes) -> None:
        """Keep one message; a stamp far from the others (a clock that jumped) begins anew."""
        if self._messages and abs(stamp_ns - self._messages[-1][0]) > self.memory_ns:
            self._messages.clear()
        self._messages.append((stamp_ns, received_ns, data))
        self.received += 1
        while stamp_ns - self._messages[0][0] > self.memory_ns:
            self._messages.popleft()

    def snapshot(self) -> tuple[Message, ...]:
        """Return what is kept now."""
        return tuple(self._messages)


@dataclass(frozen=True)
class Snapshot:
    """What was kept of some topics at an instant: a storage like that of a bag, so that what holds for one holds here.

    The same samples give the same recording as from a bag, to the last digit.
    """

    topics: tuple[Topic, ...]
    messages: tuple[tuple[Message, ...], ...]
    form = "topics"
    notes: tuple[str, ...] = ()
    truncated = False

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of messages of each topic."""
        return tuple(len(messages) for messages in self.messages)

    def batches(self, wanted: Collection[int] | None = None) -> Iterator[Batch]:
        """Yield the messages of the topics with these indices (None: of all), topic by topic."""
        for index, messages in enumerate(self.messages):
            if messages and (wanted is None or index in wanted):
                log_time = np.array([received for _, received, _ in messages], dtype=np.int64)
                yield Batch.of([data for _, _, data in messages], np.full(len(messages), index), log_time)


def recording_of(
    states: Sequence[Message],
    name: str,
    joints: Sequence[str],
    sources: Mapping[str, EffortSource] | None = None,
    others: Mapping[Topic, Sequence[Message]] | None = None,
) -> Recording:
    """Return the recording of joint states called `name`, with efforts of `others` where `sources` say so.

    InputError when nothing has come, or position or effort of a joint lacks.
    """
    if not states:
        raise InputError(f"{name}: nothing has been received")
    others = others or {}
    storage = Snapshot((Topic(name, JOINT_STATE), *others), (tuple(states), *map(tuple, others.values())))
    if not sources:
        decoder = JointStateDecoder()
        pieces = [piece for batch in storage.batches([0]) for piece in decoder.decode(batch)]
        return assemble(pieces, tuple(joints), name, name)
    return with_efforts(storage, name, name, sources, joints, joints)


class Intake:
    """Keeps the messages of the last `memory` [s], for a recording of them, and pairs positions with efforts at once.

    Positions come on `joint_states`; where the YAML declares the effort of all joints on another topic whose messages
    hold the positions as well, they come on that one, as the offline reader has it.
    """

    def __init__(
        self, node: BaseNode, robot: Robot, memory: float, depth: int, on_position: Callable[[int, Array], None]
    ) -> None:
        """Subscribe; on_position(stamp [ns], q [n] rad) is told of every joint state of this robot."""
        self._node, self._robot, self._memory, self._depth = node, robot, memory, depth
        self._on_position = on_position
        self.received = 0
        self.last = 0.0
        self._listen("joint_states")

    def _listen(self, states: str) -> None:
        """Take positions from topic `states`, and efforts from where they stand beside it."""
        self.states = states
        self._sources = sources_of(self._robot, self._node, states)
        self._pairing = Pairing(self._robot.joints, tuple(self._sources))
        self._collector = Collector(self._memory)
        self._others = {Topic(name, kind): Collector(self._memory) for name, kind in topics_of(self._sources).items()}
        self._paired = time.monotonic()
        self._efforts = EffortTopics(self._node, self._robot, self._sources, self._on_effort, self._depth)
        self._hearing = Hearing(self._node, JointState, states, reliable(self._depth), take=self._on_state, raw=True)

    def _on_state(self, data: bytes, info: dict[str, Any]) -> None:
        message = deserialize_message(data, JointState)
        received = info["received_timestamp"] or time.time_ns()
        stamp = stamp_of(message)
        self._collector.add(stamp or received, received, data)
        self.received += 1
        self.last = time.monotonic()
        values = columns(message, self._robot.joints)
        if values is None:
            return
        q, dq, tau = values
        beside = {joint: one.field for joint, one in self._sources.items() if one.topic is None}
        if beside:
            fields = {"velocity": dq, "effort": tau}
            places = {joint: self._robot.joints.index(joint) for joint in beside}
            told = {joint: fields[field] for joint, field in beside.items()}
            found = {joint: float(row[places[joint]]) for joint, row in told.items() if row is not None}
            self._pairing.add_efforts(stamp or received, received, found)
        self._pairing.add_position(stamp, received, q, tau)
        self._on_position(stamp or received, q)

    def _on_effort(self, message: EffortMessage) -> None:
        if message.positions and message.topic == self._robot.effort.topic:
            # the topic that the YAML declares turns out to hold the positions as well
            self._node.get_logger().info(
                f"positions and efforts come on {self._node.resolve_topic_name(message.topic)}"
            )
            self._efforts.close()
            self._hearing.end()
            self._listen(message.topic)
            return
        self._pairing.add_efforts(message.stamp_ns, message.received_ns, message.values)
        stamp = message.stamp_ns or message.received_ns
        other = next(kept for topic, kept in self._others.items() if topic.name == message.topic)
        other.add(stamp, message.received_ns, message.data)

    def __len__(self) -> int:
        """Return the number of joint states kept."""
        return len(self._collector)

    def take(self) -> list[Paired]:
        """Return the joint states whose efforts have come since the last time."""
        out = self._pairing.take()
        if out:
            self._paired = time.monotonic()
        return out

    def snapshot(self) -> Callable[[], Recording]:
        """Return what makes the recording of all that is kept now; that takes longer, and may be done by any thread."""
        states = self._collector.snapshot()
        others = {topic: kept.snapshot() for topic, kept in self._others.items()}
        sources, name, joints = self._sources, self.states, self._robot.joints
        return lambda: recording_of(states, name, joints, sources, others)

    def problem(self, after: float) -> str:
        """Return why efforts have been lacking for `after` [s], or an empty text."""
        now = time.monotonic()
        if self.last and now - self.last > after:
            return ""  # the positions are silent as well
        silent = self._efforts.silent(after)
        if silent or not (self._sources and self.last) or now - self._paired <= after:
            return silent
        joints = ", ".join(self._sources)
        return f"no effort of {joints} lies at the positions' stamps: do both topics stamp by the same clock?"
