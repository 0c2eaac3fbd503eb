"""Writes a rosbag2 folder while it is being recorded."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np

from robot_ident.bags import cdr
from robot_ident.bags.mcap_writer import Extent, McapFileWriter
from robot_ident.bags.message_types import complete
from robot_ident.bags.metadata import OPEN, bag_metadata, yaml_text
from robot_ident.bags.qos import profiles_of, qos_text
from robot_ident.bags.rosbag2_directory import FILES, METADATA
from robot_ident.bags.storage import Integers, Topic
from robot_ident.errors import InputError
from robot_ident.files import refuse_existing, write_text
from robot_ident.signals.motion import Array


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
            kept = f"; at least {self._kept} of its messages are kept" if self._kept else ""
            self._failure = InputError(f"{self._shown}: can't be written ({error.strerror or error}){kept}")
            raise self._failure from error

    @property
    def messages(self) -> int:
        """Number of messages written."""
        earlier = sum(extent.messages for _, extent in self._done if extent is not self._file.extent)
        return earlier + self._file.extent.messages

    @property
    def _kept(self) -> int:
        earlier = sum(extent.messages for _, extent in self._done if extent is not self._file.extent)
        return earlier + self._file.in_file

    @property
    def file_bytes(self) -> int:
        """Size of the file that is being written [bytes]."""
        return self._file.size

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
            self._file.write(topic, data, log_time_ns, publish, sequence)

    def write_joint_states(
        self,
        topic: str,
        names: tuple[str, ...],
        stamps: Integers,
        position: Array | None = None,
        velocity: Array | None = None,
        effort: Array | None = None,
    ) -> None:
        """Append N JointStates: stamps [N] ns (also as receive and send time), position, velocity, effort [N, n]."""
        rows = cdr.serialise(names, stamps, position, velocity, effort)
        size = rows.shape[1]
        content = rows.tobytes()
        for number, stamp in enumerate(np.asarray(stamps).tolist()):
            self.write(topic, content[number * size : (number + 1) * size], stamp)

    def flush(self) -> None:
        """Hand all messages to the kernel; `metadata.yaml` names all topics and files."""
        with self._lock, self._guarded():
            if self._closed:
                return
            self._file.flush()
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
                    self._file.abandon()

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
