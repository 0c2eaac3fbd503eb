"""One MCAP file, whole or broken off: chunked or not, compressed by zstd or lz4 or not, indexed or not.

A record is an opcode (1 byte), a length (8 bytes, little-endian) and that many bytes. The `mcap` package hands out one
Python object a message; here a whole file or chunk becomes a few arrays, found without a copy and never beyond the
bytes that are there, because a million messages must not cost seconds, and because a file that breaks off must give
everything before the break. Source: https://mcap.dev/spec
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from robot_ident.bags.storage import (
    DECOMPRESSORS,
    LARGEST_CHUNK,
    Batch,
    Bytes,
    Integers,
    Topic,
    most,
    one_line,
    windows,
)
from robot_ident.errors import InputError

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "robot_ident"  # in the header of our own files
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = range(1, 8)
STATISTICS, DATA_END = 0x0B, 0x0F
_KEPT = frozenset({HEADER, SCHEMA, CHANNEL, CHUNK, MESSAGE_INDEX, STATISTICS, FOOTER})
MESSAGE_HEAD = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])

_HEAD = struct.Struct("<BQ")
_STREAK = 16  # that many records of one length in a row make it worth looking for a long run
_BLOCK = 1 << 16


class Damaged(ValueError):
    """A record whose content contradicts itself."""


class Fields:
    """Reads the fields of one record in order; Damaged where they reach beyond its end."""

    def __init__(self, data: Bytes, start: int, size: int) -> None:
        """Begin at byte `start` of `data`; the record has `size` bytes."""
        self._data = memoryview(data)
        self.position = start
        self.end = start + size

    def take(self, size: int) -> memoryview:
        """Return the next `size` bytes."""
        if size > self.end - self.position:
            raise Damaged(f"a field of {size} bytes does not fit into its record")
        self.position += size
        return self._data[self.position - size : self.position]

    def number(self, size: int) -> int:
        """Return an unsigned integer of `size` bytes."""
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        """Return a string with its length before it."""
        return bytes(self.take(self.number(4))).decode("utf-8", errors="replace")

    def mapping(self) -> dict[str, str]:
        """Return a map of strings."""
        inner = self.number(4)
        end = self.position + inner
        if end > self.end:
            raise Damaged("a map does not fit into its record")
        pairs: dict[str, str] = {}
        while self.position < end:
            key = self.text()
            pairs[key] = self.text()
        return pairs


@dataclass(frozen=True)
class Scan:
    """The records in a stretch of bytes.

    start, size [N]: the content of each Message record. others: opcode, start and size of each other record. end: the
    first byte that belongs to no whole record. cut: opcode, start and remaining size of the record that breaks off.
    damage: what was found at `end`, if anything.
    """

    start: Integers
    size: Integers
    others: tuple[tuple[int, int, int], ...]
    end: int
    cut: tuple[int, int, int] | None = None
    damage: str = ""


def scan(data: Bytes, begin: int, end: int) -> Scan:
    """Return the records between two bytes of `data`, up to and including the footer or the first damage."""
    view = memoryview(data)
    starts: list[int] = []  # of messages
    sizes: list[int] = []
    gathered: list[Integers] = []  # both [2, N], of single messages and of long runs of equal size
    others: list[tuple[int, int, int]] = []
    cut, damage = None, ""
    previous, streak = -1, 0
    position, unpack = begin, _HEAD.unpack_from
    while position + 9 <= end:
        opcode, size = unpack(view, position)
        content = position + 9
        if opcode < HEADER or (opcode == MESSAGE and size < MESSAGE_HEAD.itemsize):
            damage = f"no record begins at byte {position}"
            break
        if size > end - content:
            cut = (opcode, content, end - content)
            break
        position = content + size
        if opcode == MESSAGE:
            starts.append(content)
            sizes.append(size)
            streak = streak + 1 if size == previous else 0
            previous = size
            if streak == _STREAK:
                streak = 0
                count = _run(data, position, end, size)
                run = np.full((2, count), size, dtype=np.int64)
                run[0] = position + 9 + (9 + size) * np.arange(count)
                gathered += [np.array([starts, sizes], dtype=np.int64), run]
                starts.clear()
                sizes.clear()
                position += count * (9 + size)
        elif opcode in _KEPT:
            others.append((opcode, content, size))
            if opcode == FOOTER:
                break
    start, length = np.concatenate([*gathered, np.array([starts, sizes], dtype=np.int64)], axis=1)
    return Scan(start, length, tuple(others), position, cut, damage)


def _run(data: Bytes, begin: int, end: int, size: int) -> int:
    """Return how many Message records of `size` bytes follow each other from `begin` on."""
    stride = 9 + size
    most = (end - begin) // stride
    head = np.frombuffer(_HEAD.pack(MESSAGE, size), dtype=np.uint8)
    found = 0
    block = 64
    while found < most:
        count = min(block, most - found)
        first = data[begin + found * stride :]
        heads = np.lib.stride_tricks.as_strided(first, (count, 9), (stride, 1), writeable=False)
        same = (heads == head).all(axis=1)
        if not same.all():
            return found + int(np.argmin(same))
        found += count
        block = min(2 * block, _BLOCK)
    return found


def message_heads(data: Bytes, start: Integers) -> NDArray[np.void]:
    """Return channel, sequence and both stamps of the Message records whose content begins at `start` [N]."""
    return windows(data, start, MESSAGE_HEAD.itemsize).view(MESSAGE_HEAD)[:, 0]


_GATHER = 1 << 20  # bytes of small chunks that are looked at together
_BATCH = 1 << 14  # messages; small enough that a batch stays in the cache while it is decoded


@dataclass(frozen=True)
class _Chunk:
    """One Chunk record; channels: those whose messages are in it, None where no index says so."""

    start: int
    size: int
    channels: frozenset[int] | None
    torn: bool = False


class McapFile:
    """Storage of one `.mcap` file."""

    form = "MCAP file"

    def __init__(self, path: Path) -> None:
        """Find the records; InputError when this is no MCAP file or can't be read."""
        self.path = path
        try:
            with path.open("rb") as file:
                self._data = np.frombuffer(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ), dtype=np.uint8)
        except ValueError as error:
            raise InputError(f"{path}: the file is empty") from error
        except OSError as error:
            raise InputError(f"{path}: can't be read ({error.strerror})") from error
        if self._data[:8].tobytes() != MAGIC[: len(self._data)]:
            raise InputError(f"{path}: is no MCAP file (its first bytes are {self._data[:8].tobytes()!r})")
        self._scan = scan(self._data, 8, len(self._data))
        self._schemas: dict[int, tuple[str, str, str]] = {0: ("", "", "")}
        self._topics: list[Topic] = []
        self._places: dict[tuple[str, str, str], int] = {}
        self._index = np.full(1 << 16, -1, dtype=np.int64)  # channel -> topic
        self._chunk_notes: dict[int, str] = {}
        self._claimed: dict[int, int] = {}  # by start of a chunk: bytes that it and those opened before unfold to
        self._unknown_channels = 0
        self._statistics: dict[int, int] | None = None
        self._unended = False  # an end that our recorder keeps behind what it has written so far
        self._chunks = self._read_outer_records()
        self.truncated = not self._ends_properly()

    # -- what the file holds

    def _ends_properly(self) -> bool:
        """Whether a footer and the closing magic stand where they belong, in our own files with a summary before."""
        opcode, start, size = self._scan.others[-1] if self._scan.others else (0, 0, 0)
        magic = self._data[self._scan.end : self._scan.end + 8].tobytes()
        if opcode != FOOTER or magic != MAGIC:
            return False
        if size >= 8 and not Fields(self._data, start, size).number(8):
            opcode, start, size = self._scan.others[0]
            header = Fields(self._data, start, size)
            with suppress(Damaged):
                self._unended = opcode == HEADER and (header.text(), header.text()) == ("ros2", LIBRARY)
        return not self._unended

    def _read_outer_records(self) -> tuple[_Chunk, ...]:
        """Learn schemas, channels and statistics; return the chunks with the channels that their indexes name."""
        chunks: list[tuple[int, int]] = []
        indexed: list[Counter[int]] = []
        for opcode, start, size in self._scan.others:
            if opcode == CHUNK:
                chunks.append((start, size))
                indexed.append(Counter())
            elif opcode == MESSAGE_INDEX and indexed and size >= 6:
                indexed[-1][Fields(self._data, start, size).number(2)] += (size - 6) // 16
            else:
                self._learn(self._data, opcode, start, size)
        whole = [_Chunk(*place, frozenset(known) or None) for place, known in zip(chunks, indexed, strict=True)]
        self._indexed = sum(indexed, Counter())
        if self._scan.cut and self._scan.cut[0] == CHUNK:
            whole.append(_Chunk(*self._scan.cut[1:], None, torn=True))
        return tuple(whole)

    def _learn(self, data: Bytes, opcode: int, start: int, size: int) -> None:
        """Take in a Schema, Channel or Statistics record; a damaged one is left out."""
        fields = Fields(data, start, size)
        try:
            if opcode == SCHEMA:
                number, name, encoding = fields.number(2), fields.text(), fields.text()
                self._schemas.setdefault(number, (name, encoding, fields.text()))
            elif opcode == CHANNEL:
                number, schema, name, encoding = fields.number(2), fields.number(2), fields.text(), fields.text()
                metadata = fields.mapping()
                kind, definition_encoding, definition = self._schemas.get(schema, ("", "", ""))
                qos, type_hash = (metadata.get(key, "") for key in ("offered_qos_profiles", "topic_type_hash"))
                topic = Topic(name, kind, encoding, definition, definition_encoding, qos, type_hash)
                self._index[number] = self._places.setdefault(topic.key, len(self._places))
                if len(self._places) > len(self._topics):
                    self._topics.append(topic)
            elif opcode == STATISTICS:
                fields.take(42)
                pairs = fields.number(4) // 10
                self._statistics = {fields.number(2): fields.number(8) for _ in range(pairs)}
        except Damaged as damage:
            self._chunk_notes.setdefault(start, f"a record is damaged ({damage})")

    @cached_property
    def _summarised(self) -> bool:
        """Whether the outer records can be relied upon without opening a chunk: they name every channel, and the
        indexes of the chunks hold as many messages of each as the statistics say (the chunks are the truth).
        """
        if self.truncated or self._statistics is None:
            return False
        channels = {
            Fields(self._data, start, size).number(2)
            for opcode, start, size in self._scan.others
            if opcode == CHANNEL and size >= 2
        }
        if not set(self._statistics) <= channels:
            return False
        return not self._chunks or self._indexed == +Counter(self._statistics)

    @cached_property
    def _counted(self) -> Counter[int]:
        """The number of messages by topic; opens every chunk where the summary does not say it."""
        if self._summarised and self._statistics is not None:
            by_channel = Counter(self._statistics)
        else:
            by_channel = Counter()
            for data, found in self._stretches(None):
                channels, numbers = np.unique(message_heads(data, found.start)["channel"], return_counts=True)
                by_channel.update(dict(zip(channels.tolist(), numbers.tolist(), strict=True)))
        counted: Counter[int] = Counter()
        for channel, number in by_channel.items():
            counted[int(self._index[channel])] += number
        self._unknown_channels = counted.pop(-1, 0)
        return counted

    @property
    def topics(self) -> tuple[Topic, ...]:
        """The topics, in the order found."""
        _ = self._counted  # opens the chunks that define channels, where no summary lists them
        return tuple(self._topics)

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of messages of each topic."""
        counted = self._counted
        return tuple(counted[index] for index in range(len(self._topics)))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found lost or damaged so far."""
        lines = []
        if self._unended:
            lines.append(f"{self.path.name} is truncated: its recorder did not end it; everything it wrote is used")
        elif self.truncated:
            lost = len(self._data) - self._scan.end
            what = self._scan.damage or ("its last record is cut" if self._scan.cut else "its end is missing")
            if self._scan.cut and self._scan.cut[0] == CHUNK:
                rest = f", of whose {lost} bytes what can be unpacked is used, as is everything before"
            else:
                after = f", {lost} bytes after it are lost or unreadable" if lost else ""
                rest = f"{after}; everything before is used"
            lines.append(f"{self.path.name} is truncated: {what}{rest}")
        lines += [f"{self.path.name}: {note}" for note in self._chunk_notes.values()]
        if self._unknown_channels:
            lines.append(f"{self.path.name}: {self._unknown_channels} messages of an unknown channel are left out")
        return tuple(lines)

    # -- its messages

    def batches(self, wanted: Collection[int] | None = None) -> Iterator[Batch]:
        """Yield the messages of the wanted topics in the order of the file."""
        topics = self.topics
        chosen = np.zeros(len(topics) + 1, dtype=bool)  # the last one: channels that no record defines
        chosen[list(range(len(topics)) if wanted is None else wanted)] = True
        for data, found in self._stretches(None if wanted is None else frozenset(wanted)):
            for first in range(0, len(found.start), _BATCH):
                start = found.start[first : first + _BATCH]
                size = found.size[first : first + _BATCH] - MESSAGE_HEAD.itemsize
                heads = message_heads(data, start)
                topic = self._index[heads["channel"]]
                batch = Batch(
                    data,
                    start + MESSAGE_HEAD.itemsize,
                    size,
                    np.where(topic < len(topics), topic, -1),  # the summary may not know what a chunk defines
                    heads["log_time"].astype(np.int64),
                    heads["publish_time"].astype(np.int64),
                )
                keep = chosen[batch.topic]
                if keep.all():
                    yield batch
                elif keep.any():
                    yield batch.pick(keep)

    def _stretches(self, wanted: frozenset[int] | None) -> Iterator[tuple[Bytes, Scan]]:
        """Yield the outer messages and then each chunk that may hold messages of the wanted topics."""
        if len(self._scan.start):
            yield self._data, self._scan
        gathered: list[bytes] = []
        size = 0
        for chunk in self._chunks:
            if wanted is not None and chunk.channels is not None and self._summarised:
                held = {int(self._index[channel]) for channel in chunk.channels}
                if not held & wanted:
                    continue
            gathered.append(self._open(chunk))
            size += len(gathered[-1])
            if size >= _GATHER:
                yield from self._records(gathered)
                gathered, size = [], 0
        yield from self._records(gathered)

    def _records(self, contents: list[bytes]) -> Iterator[tuple[Bytes, Scan]]:
        """Find the records of chunks: of all at once, or of each by itself where one is damaged or contradicts another
        about a channel.
        """
        data = np.frombuffer(b"".join(contents) or bytearray(), dtype=np.uint8)
        found = scan(data, 0, len(data))
        known, contradicts = self._index.copy() if found.others else self._index, False
        for opcode, start, length in found.others:
            before = self._index.copy() if opcode == CHANNEL else self._index
            self._learn(data, opcode, start, length)
            contradicts |= bool(np.any((before >= 0) & (before != self._index)))
        if len(contents) > 1 and (contradicts or found.end < len(data)):
            self._index = known
            for content in contents:
                yield from self._records([content])
        elif len(found.start):
            yield data, found

    def _open(self, chunk: _Chunk) -> bytes:
        """Return the records of a chunk, decompressed; nothing, and a note, where none of it can be used."""
        try:
            fields = Fields(self._data, chunk.start, chunk.size)
            fields.take(16)  # its first and last time
            size, checksum, compression, packed = fields.number(8), fields.number(4), fields.text(), fields.number(8)
            stored = fields.take(min(packed, fields.end - fields.position) if chunk.torn else packed)
        except Damaged as damage:
            self._chunk_notes[chunk.start] = f"a chunk is left out: {damage}"
            return b""
        decompress = DECOMPRESSORS.get(compression)
        too_large = size > LARGEST_CHUNK
        if not too_large:
            before = next(reversed(self._claimed.values()), 0)
            too_large = self._claimed.setdefault(chunk.start, before + size) > most(len(self._data))
        if decompress is None or too_large:
            unknown = f"compression {one_line(compression)!r} is not known"
            reason = unknown if decompress is None else f"it claims {size} bytes, more than any recording's"
            self._chunk_notes[chunk.start] = f"a chunk is left out: {reason}"
            return b""
        content = decompress(bytes(stored), size)
        if not chunk.torn and (len(content) != size or (checksum and zlib.crc32(content) != checksum)):
            self._chunk_notes[chunk.start] = f"a chunk of {size} bytes is damaged and left out (its checksum is wrong)"
            return b""
        return content
