"""What every storage of messages hands out: its topics, and their messages in batches of raw bytes, decompressed within
bounds: never more than was announced, and what is left of a torn stream.

What is unpacked into a temporary folder goes with the storage that did so.
"""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from robot_ident import errors
from robot_ident.errors import InputError

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

_LONGEST_LINE = 300  # characters that a message quotes
JOINT_STATE = "sensor_msgs/msg/JointState"
NUMBERS = "std_msgs/msg/Float64MultiArray"


@dataclass(frozen=True)
class Topic:
    """One topic of a bag: what is needed to read its messages, and to write them again unchanged.

    encoding: of the messages (`cdr`). definition: the text of the message type, in the language `definition_encoding`
    (`ros2msg`, `ros2idl`). qos: the offered profiles as the YAML text of the channel. type_hash: RIHS01.
    """

    name: str
    type: str
    encoding: str = "cdr"
    definition: str = ""
    definition_encoding: str = "ros2msg"
    qos: str = ""
    type_hash: str = ""

    @property
    def key(self) -> tuple[str, str, str]:
        """What makes two entries of a bag the same topic."""
        return self.name, self.type, self.encoding


@dataclass(frozen=True)
class Batch:
    """N raw messages as they lie in one buffer.

    data: the buffer. start, size [N]: where each payload lies in it. topic [N]: its index in the storage's topics.
    log_time, publish_time [N] ns: when it was received and sent.
    """

    data: Bytes
    start: Integers
    size: Integers
    topic: Integers
    log_time: Integers
    publish_time: Integers

    @classmethod
    def of(
        cls, payloads: Sequence[bytes], topic: Integers, log_time: Integers, publish_time: Integers | None = None
    ) -> Batch:
        """Return messages whose bytes lie apart; publish_time None: the receive time."""
        size = np.array([len(payload) for payload in payloads], dtype=np.int64)
        data = np.frombuffer(bytearray().join(payloads), dtype=np.uint8)
        return cls(
            data, np.cumsum(size) - size, size, topic, log_time, log_time if publish_time is None else publish_time
        )

    def __len__(self) -> int:
        """Return the number of messages N."""
        return len(self.start)

    def payload(self, index: int) -> bytes:
        """Return the bytes of one message."""
        first = int(self.start[index])
        return self.data[first : first + int(self.size[index])].tobytes()

    def pick(self, rows: NDArray[np.bool_] | Integers | slice) -> Batch:
        """Return some of the messages, over the same buffer."""
        return Batch(
            self.data, self.start[rows], self.size[rows], self.topic[rows], self.log_time[rows], self.publish_time[rows]
        )


class Storage(Protocol):
    """A file or folder of messages."""

    form: str  # in words, for messages to the user

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics, in the order found."""

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of messages of each topic that can be read."""

    @property
    def notes(self) -> tuple[str, ...]:
        """One line for each thing that was found lost or damaged so far; complete once all batches were read."""

    @property
    def truncated(self) -> bool:
        """Whether the file breaks off before its proper end."""

    def batches(self, wanted: Collection[int] | None = None) -> Iterator[Batch]:
        """Yield the messages of the topics with these indices (None: of all), in the order of the file."""


def one_line(*words: object) -> str:
    """Return words from a file, which may be damaged, so that a message that quotes them stays one short line."""
    return errors.one_line(", ".join(map(str, words)), _LONGEST_LINE)


def windows(data: Bytes, start: Integers, size: int, width: int | None = None) -> Bytes:
    """Return a copy [N, width] of the `size` bytes of `data` that begin at each of `start` [N], zeros after them."""
    width = size if width is None else width
    rows = np.empty((len(start), width), dtype=np.uint8)
    rows[:, size:] = 0
    if len(start) and size:
        stride = int(start[1] - start[0]) if len(start) > 1 else size
        if stride > 0 and np.all(np.diff(start) == stride):  # evenly spaced: strides instead of an index
            first = data[int(start[0]) :]
            rows[:, :size] = np.lib.stride_tricks.as_strided(first, (len(start), size), (stride, 1), writeable=False)
        else:
            places = (len(data) - size + 1, size)
            rows[:, :size] = np.lib.stride_tricks.as_strided(data, places, (1, 1), writeable=False)[start]
    return rows


@dataclass
class Extent:
    """What a file holds: messages by topic and together, and the first and last receive time in ns, 0 without any."""

    counts: dict[str, int]
    messages: int = 0
    first: int = 0
    last: int = 0

    def add(self, topic: str, log_time: int) -> None:
        """Count one message."""
        self.counts[topic] += 1
        self.first = min(self.first, log_time) if self.messages else log_time
        self.last = max(self.last, log_time)
        self.messages += 1


LARGEST_CHUNK = 1 << 28  # bytes; real chunks have about one megabyte, a larger claim is damage
_RATIO = 250  # a robot at rest, whose stamps alone change, compresses to a thirtieth
_FLOOR = 1 << 26  # bytes that a small file may unfold to whatever its ratio
_FLOOR_OF_MESSAGE = 1 << 14
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
_PIECE = 1 << 20


def most(stored: int) -> int:
    """Return to how many bytes a file of `stored` bytes may unfold; no recording does to more."""
    return _FLOOR + _RATIO * stored


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    pieces: list[bytes] = []
    got = 0
    stream = zstandard.ZstdDecompressor().stream_reader(data)
    with suppress(zstandard.ZstdError):  # a torn or damaged stream ends here
        while got < size and (piece := stream.read(min(_PIECE, size - got))):
            pieces.append(piece)
            got += len(piece)
    return b"".join(pieces)


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    stream = lz4.frame.LZ4FrameDecompressor()
    pieces: list[bytes] = []
    got = 0
    with suppress(RuntimeError, EOFError):  # a torn or damaged stream ends here
        for first in range(0, len(data), _PIECE):
            if stream.eof or got >= size:
                break
            pieces.append(stream.decompress(data[first : first + _PIECE], max_length=size - got))
            got += len(pieces[-1])
    return b"".join(pieces)


def _none(data: bytes, size: int) -> bytes:
    return data[:size]


DECOMPRESSORS = {"": _none, "none": _none, "zstd": _zstd, "lz4": _lz4}


def decompressed(data: bytes) -> bytes:
    """Return a message that rosbag2 compressed by itself (`--compression-mode message`, zstd), or any other unchanged.

    What can't be decompressed comes out empty, which no reader takes for a message.
    """
    import zstandard

    if data[: len(ZSTD_MAGIC)] != ZSTD_MAGIC:
        return data
    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        return b""
    return _zstd(data, size) if 0 <= size <= min(LARGEST_CHUNK, _FLOOR_OF_MESSAGE + _RATIO * len(data)) else b""


def unpack_file(path: Path, to: Path) -> str:
    """Write the content of the .zstd file `path` to `to`; return a note when it breaks off or unfolds to too much."""
    import zstandard

    left = limit = most(path.stat().st_size)
    with path.open("rb") as source, to.open("wb") as sink:
        reader = zstandard.ZstdDecompressor().stream_reader(source, read_across_frames=True)
        try:
            while piece := reader.read(min(_PIECE, left)):
                left -= sink.write(piece)
            if not left and reader.read(1):
                return f"{path.name}: unfolds to more than any recording does; its first {limit} bytes are used"
        except zstandard.ZstdError as error:
            return f"{path.name}: its compression breaks off ({error}); what came before is used"
    return ""


def scratch_folder(owner: object) -> Path:
    """Make a folder under the system's temporary one, removed with its owner or at the end of the process; InputError
    when the disk refuses.
    """
    try:
        path = Path(tempfile.mkdtemp(prefix="robot_ident_"))
    except OSError as error:
        raise InputError(f"{tempfile.gettempdir()}: no temporary folder can be made ({error.strerror})") from error
    weakref.finalize(owner, shutil.rmtree, path, ignore_errors=True)
    return path
