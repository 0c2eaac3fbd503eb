"""How far a bag has come that another process is writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_ident.bags.compression import DECOMPRESSORS
from robot_ident.bags.mcap_records import CHANNEL, CHUNK, MAGIC, MESSAGE_HEAD, Fields, chunk_fields, message_heads, scan
from robot_ident.bags.storage import Bytes
from robot_ident.playback.stamps import header_stamp


class BagGrowth:
    """Follows one topic of messages with a header through the files of a `BagWriter` while they grow.

    Each look reads what has been written since the one before, and nothing twice.
    """

    def __init__(self, bag: Path, topic: str) -> None:
        """Follow a topic; neither it nor the bag need be there yet."""
        self._bag, self._topic = bag, topic
        self._number = 0  # of the file that is followed
        self._read = 0  # bytes of it
        self._channels: set[int] = set()
        self._first = self._newest = 0  # ns

    def seconds(self) -> float:
        """Return the time between the first message's stamp and the newest one's [s], 0 before there are two."""
        while (file := self._file(self._number)).is_file():
            last = not self._file(self._number + 1).is_file()
            self._look(file)
            if last:
                break
            self._number, self._read = self._number + 1, 0
            self._channels.clear()
        return (self._newest - self._first) * 1e-9

    def _file(self, number: int) -> Path:
        return self._bag / f"{self._bag.name}_{number}.mcap"

    def _look(self, file: Path) -> None:
        """Read the chunks that have become whole."""
        with file.open("rb") as stream:
            stream.seek(self._read)
            data = np.frombuffer(stream.read(), dtype=np.uint8)
        begin = len(MAGIC) if not self._read else 0
        chunks = [(start, size) for opcode, start, size in scan(data, begin, len(data)).others if opcode == CHUNK]
        for start, size in chunks:
            unpacked, _, compression, packed = chunk_fields(data, start, size)
            content = DECOMPRESSORS[compression](bytes(packed), unpacked)
            self._take(np.frombuffer(content, dtype=np.uint8))
        if chunks:
            self._read += sum(chunks[-1])

    def _take(self, data: Bytes) -> None:
        """Take in the channels and stamps of one chunk."""
        found = scan(data, 0, len(data))
        for opcode, start, size in found.others:
            if opcode == CHANNEL:
                fields = Fields(data, start, size)
                channel, _, name = fields.number(2), fields.number(2), fields.text()
                self._channels |= {channel} if name == self._topic else set()
        heads = message_heads(data, found.start)
        ours = np.flatnonzero(np.isin(heads["channel"], list(self._channels)))
        for place in ours[[0, -1]] if len(ours) else ():
            content = int(found.start[place]) + MESSAGE_HEAD.itemsize
            self._newest = header_stamp(data[content : content + 12].tobytes())
            self._first = self._first or self._newest
