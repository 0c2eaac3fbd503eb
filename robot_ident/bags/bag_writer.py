"""Writes a rosbag2 folder while it is being recorded, in MCAP files that every reader opens at any moment, however
their writer ends; a whole recording at once: such a folder, a single `.mcap`, or a table; predicted torque beside it.
"""

from __future__ import annotations

import heapq
import os
import shutil
import struct
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import IO, Any, cast

import numpy as np

from robot_ident.bags import cdr
from robot_ident.bags.mcap_file import DATA_END, FOOTER, LIBRARY, MAGIC
from robot_ident.bags.read import TABLES
from robot_ident.bags.rosbag2 import (
    FILES,
    METADATA,
    OPEN,
    Qos,
    bag_metadata,
    complete,
    profiles_of,
    qos_text,
    yaml_text,
)
from robot_ident.bags.storage import JOINT_STATE, Extent, Integers, Topic
from robot_ident.bags.tables import write_table
from robot_ident.errors import InputError
from robot_ident.estimation.prediction import Prediction
from robot_ident.files import refuse_existing, whole, write_text
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array

CHUNK_BYTES = 1 << 20
# What stands behind the last whole record while the file grows: an end of the data and a footer without a summary.
PROVISIONAL_END = struct.pack("<BQI", DATA_END, 4, 0) + struct.pack("<BQQQI", FOOTER, 20, 0, 0, 0) + MAGIC


class McapFileWriter:
    """One MCAP file in rosbag2's manner: profile `ros2`, chunks with an index, type hash and QoS in each channel,
    rosbag2's metadata.

    Whole records are collected and handed to the kernel together, in one write with what ends the file after them. A
    process that is killed thus leaves an MCAP file that ends properly with whatever was written last; a power cut takes
    what was not yet synced.
    """

    def __init__(self, path: Path, *, compress: bool) -> None:
        """Create the file; OSError when it exists or can't be created. compress: the chunks, by zstd."""
        from mcap.writer import CompressionType, Writer

        self.name = path.name
        self.extent = Extent({})
        self.in_file = 0  # messages that the kernel has; the others wait in an unfinished chunk
        self._file = path.open("xb", buffering=0)
        self._closing = threading.Lock()
        self._end = 0  # bytes in the file that stay
        self._waiting = bytearray()
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(cast("IO[Any]", self), chunk_size=CHUNK_BYTES, compression=compression)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._commit()
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

    def add_message(self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int) -> None:
        """Append one message to the chunk in progress; a full one is written."""
        self._writer.add_message(self._channels[topic], log_time, data, publish_time, sequence)
        self.extent.add(topic, log_time)
        if self._waiting:
            self._commit()

    def finish_chunk(self) -> None:
        """Finish the chunk in progress and write it."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        if self._waiting:
            self._commit()

    # -- the stream into which the `mcap` package writes

    def write(self, data: bytes) -> int:
        """Take whole records, which wait for a commit."""
        self._waiting += data
        return len(data)

    def flush(self) -> None:
        """Write nothing."""

    def tell(self) -> int:
        """Return the number of bytes in the file or waiting."""
        return self._end + len(self._waiting)

    # -- the file

    def _commit(self, end: bytes = PROVISIONAL_END) -> None:
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
        self.in_file = self.extent.messages

    def _put(self, content: bytes) -> None:
        done = 0
        while done < len(content):
            done += os.pwrite(self._file.fileno(), content[done:], self._end + done)

    def sync(self) -> None:
        """Wait until the disk has what was written."""
        with self._closing:
            if not self._file.closed:
                os.fdatasync(self._file.fileno())

    def finish(self, metadata: str) -> None:
        """Write rosbag2's metadata, the index and the summary, and close."""
        self.finish_chunk()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._commit(b"")
        self.sync()
        self.close()

    def close(self) -> None:
        """Close without an end of its own: the file reads as one whose recorder was killed. Once closed, do nothing."""
        with self._closing:
            self._file.close()


class BagWriter:
    """A rosbag2 folder (MCAP) that grows in its final place; may be used from several threads.

    Every reader opens it at any moment: what was written before the last `flush` is there however the process ends, and
    `sync` once a second bounds what a power cut can take. `close` writes index, summary and the final `metadata.yaml`.
    `custom_data` goes into that.
    """

    def __init__(
        self,
        path: Path | str,
        topics: Iterable[Topic] = (),
        *,
        compress: bool = True,
        force: bool = False,
        shown_as: Path | str | None = None,
    ) -> None:
        """Create the folder; InputError when it exists (and not `force`) or can't be written.

        topics: name and type are enough for the standard types. compress: the files, by zstd. shown_as: the name in
        messages to the user.
        """
        self.path = Path(path)
        self.custom_data: dict[str, str] = {}
        self._shown = shown_as or path
        self._compress = compress
        self._lock = threading.RLock()
        self._topics: dict[str, Topic] = {}
        self._done: list[tuple[str, Extent]] = []
        self._told = (0, 0)  # topics and finished files that `metadata.yaml` knows
        self._failure: InputError | None = None
        self._closed = False
        refuse_existing(self.path, force=force)
        try:
            _clear_bag(self.path)
            self.path.mkdir()
            self._file = self._next_file()
        except OSError as error:
            raise InputError(f"{self._shown}: can't be written ({error.strerror or error})") from error
        for topic in topics:
            self.add_topic(topic)

    def _next_file(self) -> McapFileWriter:
        name = f"{self.path.name}_{len(self._done)}.mcap"
        return McapFileWriter(self.path / name, compress=self._compress)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Turn a disk's refusal into one line, now and for every later write."""
        if self._failure is not None:
            raise self._failure
        try:
            yield
        except OSError as error:
            count = self.messages - self._file.extent.messages + self._file.in_file
            kept = f"; at least {count} of its messages are kept" if count else ""
            self._failure = InputError(f"{self._shown}: can't be written ({error.strerror or error}){kept}")
            raise self._failure from error

    @property
    def messages(self) -> int:
        """Number of messages written."""
        earlier = sum(extent.messages for _, extent in self._done if extent is not self._file.extent)
        return earlier + self._file.extent.messages

    @property
    def file_bytes(self) -> int:
        """Size of the file that is being written [bytes]."""
        return self._file.tell()

    def add_topic(self, topic: Topic) -> None:
        """Make a topic known; a second time it changes nothing."""
        with self._lock, self._guarded():
            if topic.name in self._topics:
                return
            topic = complete(replace(topic, qos=qos_text(profiles_of(topic.qos))))
            self._file.add_topic(topic)
            self._topics[topic.name] = topic

    def write(
        self, topic: str, data: bytes, log_time_ns: int, publish_time_ns: int | None = None, sequence: int = 0
    ) -> None:
        """Append one serialized message (CDR, as it came from DDS) with its receive and send stamp."""
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        with self._lock, self._guarded():
            self._file.add_message(topic, data, log_time_ns, publish, sequence)

    def flush(self) -> None:
        """Hand all messages to the kernel; `metadata.yaml` names all topics and files."""
        with self._lock, self._guarded():
            if self._closed:
                return
            self._file.finish_chunk()
            if self._told != (len(self._topics), len(self._done)):
                self._tell_progress()

    def sync(self) -> None:
        """Wait until the disk has all messages, with a `metadata.yaml` that says how far the bag has come.

        Other threads go on writing meanwhile.
        """
        self.flush()
        with self._guarded():
            self._file.sync()
            with self._lock:
                if not self._closed:
                    self._tell_progress()

    def _tell_progress(self) -> None:
        """Write the `metadata.yaml` of a bag that is open."""
        self._told = (len(self._topics), len(self._done))
        self._write_metadata([*self._done, (self._file.name, self._file.extent)], {OPEN: "true"})

    def split(self) -> None:
        """Finish the present file and go on in the next one of the folder."""
        with self._lock, self._guarded():
            self._finish_file()
            self._file = self._next_file()
            for topic in self._topics.values():
                self._file.add_topic(topic)

    def _finish_file(self) -> None:
        done = (self._file.name, self._file.extent)
        self._file.finish(yaml_text(bag_metadata(self._topics.values(), [*self._done, done], self.custom_data)))
        self._done.append(done)

    def close(self) -> None:
        """Write index, summary and `metadata.yaml`; a failed write leaves the folder as a killed process does."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            try:
                if self._failure is None:  # else the write that met it has told it
                    with self._guarded():
                        self._finish_file()
                        self._write_metadata(self._done, self.custom_data)
            finally:
                with suppress(OSError):
                    self._file.close()

    def _write_metadata(self, files: Sequence[tuple[str, Extent]], custom_data: Mapping[str, str]) -> None:
        content = bag_metadata(self._topics.values(), files, custom_data)
        write_text(self.path / METADATA, yaml_text({"rosbag2_bagfile_information": content}), force=True)

    def __enter__(self) -> BagWriter:
        """Return the writer."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the bag."""
        self.close()


def _clear_bag(path: Path) -> None:
    """Remove an existing bag, and nothing that is none."""
    if not path.exists():
        return
    bag = path.is_dir() and all(file.suffix in FILES or file.name == METADATA for file in path.iterdir())
    if not bag:
        raise InputError(f"{path}: is replaced only if it is a rosbag2 folder and nothing else; it is not")
    shutil.rmtree(path)


_AT_ONCE = 65_536  # messages
_LAST = 2**31 * 1_000_000_000  # ns; seconds are a signed number of 32 bits in builtin_interfaces/Time


@dataclass(frozen=True)
class Series:
    """N JointStates on one topic: stamps [N] ns (also receive and send time), position, velocity, effort [N, n]."""

    topic: str
    names: tuple[str, ...]
    stamps: Integers
    position: Array | None = None
    velocity: Array | None = None
    effort: Array | None = None

    def messages(self) -> Iterator[tuple[int, str, bytes]]:
        """Yield stamp, topic and bytes (CDR) of the messages in the order of their stamps."""
        order = np.argsort(self.stamps, kind="stable")
        for rows in np.split(order, range(_AT_ONCE, len(order), _AT_ONCE)):
            q, dq, tau = (None if part is None else part[rows] for part in (self.position, self.velocity, self.effort))
            messages = cdr.serialise(self.names, self.stamps[rows], q, dq, tau)
            for stamp, row in zip(self.stamps[rows].tolist(), messages, strict=True):
                yield stamp, self.topic, row.tobytes()


def write_recording(
    path: Path | str,
    recording: Recording,
    *,
    start_ns: int | None = None,
    topic: str = "/joint_states",
    force: bool = False,
) -> None:
    """Write a recording, whole or not at all, in the form that the suffix of `path` names (none: a rosbag2 folder).

    start_ns: the stamp of t = 0; None takes the recording's own, or else the present time, since a stamp of zero means
    that there is none. topic: of the JointState messages. InputError when the path exists (and not `force`) or the disk
    refuses.
    """
    path = Path(path)
    with whole(path, force=force) as draft:
        if path.suffix in TABLES:
            arrays = {"t": recording.t, "q": recording.q, "tau": recording.tau, "names": np.array(recording.names)}
            write_table(draft, path.suffix, arrays if recording.dq is None else {**arrays, "dq": recording.dq})
            return
        start = start_ns or max(recording.start_ns, 0) or time.time_ns()
        stamps = start + np.rint(recording.t * 1e9).astype(np.int64)
        if len(stamps) and not 0 <= stamps[0] <= stamps[-1] < _LAST:
            raise InputError(
                f"{path}: it would last from {stamps[0] / 1e9:.0f} to {stamps[-1] / 1e9:.0f} s since 1970;"
                " the stamps of ROS 2 end in 2038"
            )
        states = Series(topic, recording.names, stamps, recording.q, recording.dq, recording.tau)
        _write_bag(draft, path, [states])


def write_series(path: Path | str, series: Sequence[Series], *, force: bool = False) -> None:
    """Write topics of JointStates, whole or not at all: one `.mcap` file, or else a rosbag2 folder.

    The messages of all topics come in the order of their stamps. InputError when the path exists (and not `force`) or
    the disk refuses.
    """
    path = Path(path)
    with whole(path, force=force) as draft:
        _write_bag(draft, path, series)


def _write_bag(draft: Path, path: Path, series: Sequence[Series]) -> None:
    folder = draft.with_name(path.stem) if path.suffix == ".mcap" else draft
    topics = [Topic(one.topic, JOINT_STATE, qos=qos_text([Qos()])) for one in series]
    with BagWriter(folder, topics, shown_as=path) as bag:
        for stamp, topic, message in heapq.merge(*(one.messages() for one in series), key=itemgetter(0)):
            bag.write(topic, message, stamp)
    if path.suffix == ".mcap":
        (folder / f"{folder.name}_0.mcap").rename(draft)


def write_prediction(path: Path | str, prediction: Prediction, *, force: bool = False) -> None:
    """Write a prediction, whole or not at all, in the form that the suffix of `path` names (none: a rosbag2 folder).

    .npz: t, q, dq, ddq, tau, tau_std, tau_band [N, n] and names; .csv: the same by column. Bags: the topics /predicted,
    /predicted_lower and /predicted_upper, the band's ends. InputError when the path exists (and not `force`).
    """
    path = Path(path)
    if path.suffix not in TABLES:
        stamps = (prediction.start_ns or time.time_ns()) + np.rint(prediction.t * 1e9).astype(np.int64)
        q, dq = prediction.motion.q, prediction.motion.dq
        efforts = {
            "/predicted": prediction.torque,
            "/predicted_lower": prediction.torque - prediction.band,
            "/predicted_upper": prediction.torque + prediction.band,
        }
        series = [Series(topic, prediction.joints, stamps, q, dq, effort) for topic, effort in efforts.items()]
        write_series(path, series, force=force)
        return
    arrays = {"t": prediction.t, "names": np.array(prediction.joints)}
    arrays |= {key: getattr(prediction.motion, key) for key in ("q", "dq", "ddq")}
    arrays |= {"tau": prediction.torque, "tau_std": prediction.std, "tau_band": prediction.band}
    with whole(path, force=force) as draft:
        write_table(draft, path.suffix, arrays, digits=12)
