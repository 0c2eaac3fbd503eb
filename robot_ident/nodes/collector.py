"""Keeps the latest joint states as they came from DDS, and makes a recording of them as the offline reader does."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from robot_ident.bags.assemble import assemble
from robot_ident.bags.joint_state_decoder import JointStateDecoder
from robot_ident.bags.storage import Batch
from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording


class Collector:
    """Serialized JointStates of the last `memory` [s], by their header stamps.

    They go through the same decoder as those of a bag: the same samples give the same recording, to the last digit.
    """

    def __init__(self, memory: float, source: str) -> None:
        """Keep `memory` [s] of what is called `source` in messages to the user."""
        self.memory_ns = round(memory * 1e9)
        self.source = source
        self.received = 0
        self._messages: deque[tuple[int, int, bytes]] = deque()

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

    def snapshot(self) -> list[tuple[int, int, bytes]]:
        """Return what is kept now, for `recording`, which takes longer."""
        return list(self._messages)

    def recording(self, messages: Sequence[tuple[int, int, bytes]], joints: Sequence[str]) -> Recording:
        """Return the recording of some messages; InputError when they lack position or effort of a joint."""
        if not messages:
            raise InputError(f"{self.source}: nothing has been received")
        payloads = [data for _, _, data in messages]
        size = np.array([len(data) for data in payloads], dtype=np.int64)
        log = np.array([received for _, received, _ in messages], dtype=np.int64)
        content = np.frombuffer(bytearray().join(payloads), dtype=np.uint8)
        batch = Batch(content, np.cumsum(size) - size, size, np.zeros(len(size), dtype=np.int64), log, log)
        decoder = JointStateDecoder()
        return assemble(list(decoder.decode(batch)), tuple(joints), self.source, self.source)
