"""Writes one MCAP file that every reader opens at any moment, however its writer ends."""

from __future__ import annotations

import os
import struct
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from robot_ident.bags.mcap_records import DATA_END, FOOTER, LIBRARY, MAGIC
from robot_ident.bags.storage import Topic

CHUNK_BYTES = 1 << 20
# What stands behind the last whole record while the file grows: an end of the data and a footer without a summary.
PROVISIONAL_END = struct.pack("<BQI", DATA_END, 4, 0) + struct.pack("<BQQQI", FOOTER, 20, 0, 0, 0) + MAGIC


class RecordFile:
    """Collects records and hands them to the kernel together, in one write with what ends the file after them.

    A process that is killed thus leaves an MCAP file that ends properly with whatever was committed last; a power cut
    takes what was not yet synced.
    """

    def __init__(self, path: Path) -> None:
        """Create the file; OSError when it exists or can't be created."""
        self._file = path.open("xb", buffering=0)
        self._closing = threading.Lock()
        self._end = 0
        self._waiting = bytearray()

    def write(self, data: bytes) -> int:
        """Take whole records; `commit` writes them."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written or taken."""
        return self._end + len(self._waiting)

    @property
    def waiting(self) -> bool:
        """Whether records were taken that aren't written."""
        return bool(self._waiting)

    def commit(self, end: bytes = PROVISIONAL_END) -> None:
        """Write what was taken, and `end` behind it, over the previous end.

        On OSError (a full disk) the file ends as it ended before.
        """
        size = len(self._waiting)
        content = bytes(self._waiting) + end
        self._waiting.clear()
        try:
            self._put(content)
        except OSError:
            with suppress(OSError):  # a reader copes with the torn record as well
                os.truncate(self._file.fileno(), self._end)
                self._put(PROVISIONAL_END)
            raise
        self._end += size

    def _put(self, content: bytes) -> None:
        done = 0
        while done < len(content):
            done += os.pwrite(self._file.fileno(), content[done:], self._end + done)

    def flush(self) -> None:
        """Write nothing: what is taken waits for `commit`."""

    def sync(self) -> None:
        """Wait until the disk has what was written."""
        with self._closing:
            if not self._file.closed:
                os.fdatasync(self._file.fileno())

    def close(self) -> None:
        """Close the file; a second time it does nothing."""
        with self._closing:
            self._file.close()


@dataclass
class Extent:
    """What a file holds: messages by topic, and the first and last receive time in ns."""

    counts: dict[str, int]
    first: int = 2**63 - 1
    last: int = 0

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    @property
    def start(self) -> int:
        """First receive time [ns], 0 without messages."""
        return self.first if self.messages else 0

    @property
    def duration(self) -> int:
        """Time from the first to the last message [ns]."""
        return self.last - self.first if self.messages else 0


class McapFileWriter:
    """One MCAP file in rosbag2's manner: profile `ros2`, chunks with an index, type hash and QoS in each channel,
    rosbag2's metadata.
    """

    def __init__(self, path: Path, *, compress: bool) -> None:
        """Create the file. compress: the chunks, by zstd."""
        from mcap.writer import CompressionType, Writer

        self.name = path.name
        self.extent = Extent({})
        self._file = RecordFile(path)
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(cast("IO[Any]", self._file), chunk_size=CHUNK_BYTES, compression=compression)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._file.commit()
        self.in_file = 0  # messages that the kernel has; the others wait in an unfinished chunk
        self._added = 0
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_topic(self, topic: Topic) -> None:
        """Take in schema and channel of a topic."""
        if topic.type not in self._schemas:
            encoding = topic.definition_encoding if topic.definition else ""
            schema = self._writer.register_schema(topic.type, encoding, topic.definition.encode())
            self._schemas[topic.type] = schema
        metadata = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type_hash}
        schema = self._schemas[topic.type]
        self._channels[topic.name] = self._writer.register_channel(topic.name, topic.encoding, schema, metadata)
        self.extent.counts[topic.name] = 0

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int) -> None:
        """Append one message to the chunk in progress; a full one is written."""
        self._writer.add_message(self._channels[topic], log_time, data, publish_time, sequence)
        extent = self.extent
        extent.counts[topic] += 1
        extent.first = min(extent.first, log_time)
        extent.last = max(extent.last, log_time)
        self._added += 1
        if self._file.waiting:
            self._commit()

    def flush(self) -> None:
        """Finish the chunk in progress and write it."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        if self._file.waiting:
            self._commit()

    def _commit(self) -> None:
        self._file.commit()
        self.in_file = self._added

    def sync(self) -> None:
        """Wait until the disk has what was flushed."""
        self._file.sync()

    @property
    def size(self) -> int:
        """Bytes in the file so far."""
        return self._file.tell()

    def finish(self, metadata: str) -> None:
        """Write rosbag2's metadata, the index and the summary, and close."""
        self.flush()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.commit(b"")
        self._file.sync()
        self._file.close()

    def abandon(self) -> None:
        """Close without an end of its own; the file reads as one whose recorder was killed."""
        self._file.close()
