"""Writes one MCAP file so that a torn write never hides what was written before it."""

from __future__ import annotations

import os
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, cast

from robot_ident.bags.storage import Topic

CHUNK_BYTES = 1 << 20


class RecordFile:
    """An unbuffered file: each write is in the kernel's hands when it returns, or leaves no trace.

    A process that is killed thus loses nothing that `write` returned for; a power cut, what was not yet synced.
    """

    def __init__(self, path: Path) -> None:
        """Create the file; OSError when it exists or can't be created."""
        self._file = path.open("xb", buffering=0)
        self._closing = threading.Lock()
        self._end = 0

    def write(self, data: bytes) -> int:
        """Append whole records; on OSError (a full disk) the file ends where it ended before."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError:
            with suppress(OSError):  # a reader copes with the torn record as well
                self._file.truncate(self._end)
                self._file.seek(self._end)
            raise
        self._end += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._end

    def flush(self) -> None:
        """Nothing waits here: every write went to the kernel at once."""

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
    """One MCAP file in rosbag2's manner: profile `ros2`, type hash and QoS in each channel, rosbag2's metadata."""

    def __init__(self, path: Path, *, chunked: bool) -> None:
        """Create the file. chunked: compressed chunks with an index; else every message goes to the kernel at once."""
        from mcap.writer import CompressionType, Writer

        self.name = path.name
        self.extent = Extent({})
        self._file = RecordFile(path)
        compression = CompressionType.ZSTD if chunked else CompressionType.NONE
        sink = cast("IO[Any]", self._file)
        self._writer = Writer(sink, chunk_size=CHUNK_BYTES, compression=compression, use_chunking=chunked)
        self._writer.start(profile="ros2", library="robot_ident")
        self.in_file = 0  # messages that the kernel has; the others wait in an unfinished chunk
        self._added = 0
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}

    def add_topic(self, topic: Topic) -> None:
        """Write schema and channel of a topic."""
        if topic.type not in self._schemas:
            encoding = topic.definition_encoding if topic.definition else ""
            schema = self._writer.register_schema(topic.type, encoding, topic.definition.encode())
            self._schemas[topic.type] = schema
        metadata = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type_hash}
        schema = self._schemas[topic.type]
        self._channels[topic.name] = self._writer.register_channel(topic.name, topic.encoding, schema, metadata)
        self.extent.counts[topic.name] = 0
        self._writer.flush()  # type: ignore[no-untyped-call]

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int) -> None:
        """Append one message."""
        end = self._file.tell()
        self._writer.add_message(self._channels[topic], log_time, data, publish_time, sequence)
        extent = self.extent
        extent.counts[topic] += 1
        extent.first = min(extent.first, log_time)
        extent.last = max(extent.last, log_time)
        self._added += 1
        if self._file.tell() > end:  # unchunked: always; else when this message filled its chunk
            self.in_file = self._added

    def flush(self) -> None:
        """Finish the chunk in progress."""
        self._writer.flush()  # type: ignore[no-untyped-call]
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
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self.flush()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.sync()
        self._file.close()

    def abandon(self) -> None:
        """Close without an end; the file reads as a truncated one."""
        self._file.close()
