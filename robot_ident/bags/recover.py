"""How far a bag has come that another process is writing, and a whole rosbag2 folder of one that breaks off, so that
every other tool reads it again.
"""

from __future__ import annotations

import heapq
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_ident.bags.bag_writer import BagWriter
from robot_ident.bags.mcap_file import MAGIC
from robot_ident.bags.read import RawMessage, open_storage, raw_messages
from robot_ident.bags.storage import Storage
from robot_ident.errors import InputError
from robot_ident.files import refuse_existing, whole
from robot_ident.playback.stamps import header_stamp


@dataclass(frozen=True)
class Recovery:
    """What `recover` did. kept: messages by topic. lost: one line for each loss, none for a bag that was whole."""

    source: str
    output: str
    kept: dict[str, int]
    lost: tuple[str, ...]

    @property
    def messages(self) -> int:
        """Number of messages kept."""
        return sum(self.kept.values())


def recover(path: Path | str, out: Path | str, *, force: bool = False) -> Recovery:
    """Copy every readable message of a bag, unchanged, into a whole rosbag2 folder with index and `metadata.yaml`.

    The messages come in the order of their receive times. The stamps, definitions, hashes and QoS stay. InputError when
    nothing can be read or `out` exists (and not `force`).
    """
    path, out = Path(path), Path(out)
    refuse_existing(out, force=force)
    if out.exists() and out.samefile(path):
        raise InputError(f"{out}: is the bag itself; give another name")
    storage = open_storage(path)
    impossible = 0
    kept: Counter[str] = Counter({topic.name: 0 for topic in storage.topics})
    with whole(out, force=force) as draft:
        with BagWriter(draft, storage.topics, shown_as=out) as bag:
            for message in in_time_order(storage):
                if message.topic.name not in kept:  # a channel that was declared anew has two names
                    bag.add_topic(message.topic)
                log_time, publish_time = max(message.log_time, 0), max(message.publish_time, 0)
                bag.write(message.topic.name, message.data, log_time, publish_time)
                kept[message.topic.name] += 1
                impossible += message.log_time < 0 or message.publish_time < 0
            bag.custom_data["recovered_from"] = path.name
        if not kept.total():
            raise InputError(f"{path}: no message can be read ({'; '.join(storage.notes) or 'the bag is empty'})")
    lost = storage.notes
    if impossible:
        lost += (f"{impossible} messages had a receive or send time after the year 2262; it is set to 0",)
    return Recovery(str(path), str(out), dict(kept), lost)


def in_time_order(storage: Storage) -> Iterator[RawMessage]:
    """Yield the messages of a storage by receive time, those of one time in the order of the file.

    No more are held at once than the file has out of place: a first pass finds how late a message comes at most.
    """
    newest, latest = np.iinfo(np.int64).min, 0
    for batch in storage.batches():
        before = np.maximum.accumulate(np.append(newest, batch.log_time))
        latest = max(latest, int((before[:-1] - batch.log_time)[before[:-1] > batch.log_time].max(initial=0)))
        newest = int(before[-1])
    held: list[tuple[int, int, RawMessage]] = []
    for number, message in enumerate(raw_messages(storage)):
        heapq.heappush(held, (message.log_time, number, message))
        while held and held[0][0] <= message.log_time - latest:
            yield heapq.heappop(held)[2]
    while held:
        yield heapq.heappop(held)[2]


class BagGrowth:
    """Follows one topic of messages with a header through the files of a `BagWriter` while they grow.

    Each look reads what has been written since the one before, and nothing twice.
    """

    def __init__(self, bag: Path, topic: str) -> None:
        """Follow a topic; neither it nor the bag need be there yet."""
        self._bag, self._topic = bag, topic
        self._number = 0  # of the file that is followed
        self._read = len(MAGIC)  # bytes of it
        self._channels: set[int] = set()
        self._first = self._newest = 0  # ns

    def seconds(self) -> float:
        """Return the time between the first message's stamp and the newest one's [s], 0 before there are two."""
        while (file := self._file(self._number)).is_file():
            last = not self._file(self._number + 1).is_file()
            self._look(file)
            if last:
                break
            self._number, self._read = self._number + 1, len(MAGIC)
            self._channels.clear()
        return (self._newest - self._first) * 1e-9

    def _file(self, number: int) -> Path:
        return self._bag / f"{self._bag.name}_{number}.mcap"

    def _look(self, file: Path) -> None:
        """Read the chunks that have become whole."""
        from mcap.exceptions import McapError
        from mcap.records import Channel, Chunk, Message
        from mcap.stream_reader import StreamReader, breakup_chunk

        with file.open("rb") as stream, suppress(McapError, struct.error):  # the rest is still being written
            stream.seek(self._read)
            for record in StreamReader(stream, skip_magic=True, emit_chunks=True).records:
                if not isinstance(record, Chunk):
                    continue
                for inner in breakup_chunk(record):
                    if isinstance(inner, Channel) and inner.topic == self._topic:
                        self._channels.add(inner.id)
                    elif isinstance(inner, Message) and inner.channel_id in self._channels:
                        self._newest = header_stamp(inner.data)
                        self._first = self._first or self._newest
                self._read = stream.tell()
