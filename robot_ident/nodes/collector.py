"""Keeps the latest messages as they came from DDS, and makes a recording of them as the offline reader does."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.bags import JOINT_STATE, Topic
from robot_ident.bags.assemble import assemble
from robot_ident.bags.efforts_elsewhere import with_efforts
from robot_ident.bags.joint_state_decoder import JointStateDecoder
from robot_ident.bags.storage import Batch
from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording
from robot_ident.robot.effort import EffortSource

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

    def clear(self) -> None:
        """Forget everything."""
        self._messages.clear()

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
                yield _batch(messages, index)


def _batch(messages: Sequence[Message], index: int) -> Batch:
    payloads = [data for _, _, data in messages]
    size = np.array([len(data) for data in payloads], dtype=np.int64)
    log = np.array([received for _, received, _ in messages], dtype=np.int64)
    content = np.frombuffer(bytearray().join(payloads), dtype=np.uint8)
    return Batch(content, np.cumsum(size) - size, size, np.full(len(size), index, dtype=np.int64), log, log)


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
    if not sources:
        decoder = JointStateDecoder()
        return assemble(list(decoder.decode(_batch(states, 0))), tuple(joints), name, name)
    others = others or {}
    storage = Snapshot((Topic(name, JOINT_STATE), *others), (tuple(states), *map(tuple, others.values())))
    return with_efforts(storage, name, name, sources, joints, joints)
