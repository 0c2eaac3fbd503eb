"""The records of an MCAP file, found without a copy and never beyond the bytes that are there.

A record is an opcode (1 byte), a length (8 bytes, little-endian) and that many bytes. The `mcap` package hands out one
Python object a message; here a whole file or chunk becomes a few arrays, because a million messages must not cost
seconds, and because a file that breaks off must give everything before the break.
Source: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_ident.bags.storage import Bytes, Integers, windows

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


class _Messages:
    """Collects where Message records lie: single ones, and long runs of equal length."""

    def __init__(self) -> None:
        self._starts: list[Integers] = []
        self._sizes: list[Integers] = []
        self._single_starts: list[int] = []
        self._single_sizes: list[int] = []

    def add(self, start: int, size: int) -> None:
        self._single_starts.append(start)
        self._single_sizes.append(size)

    def add_run(self, start: int, size: int, count: int) -> None:
        self._gather()
        self._starts.append(start + (9 + size) * np.arange(count, dtype=np.int64))
        self._sizes.append(np.full(count, size, dtype=np.int64))

    def _gather(self) -> None:
        self._starts.append(np.array(self._single_starts, dtype=np.int64))
        self._sizes.append(np.array(self._single_sizes, dtype=np.int64))
        self._single_starts.clear()
        self._single_sizes.clear()

    def arrays(self) -> tuple[Integers, Integers]:
        self._gather()
        return np.concatenate(self._starts), np.concatenate(self._sizes)


def scan(data: Bytes, begin: int, end: int) -> Scan:
    """Return the records between two bytes of `data`, up to and including the footer or the first damage."""
    view = memoryview(data)
    messages = _Messages()
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
            messages.add(content, size)
            streak = streak + 1 if size == previous else 0
            previous = size
            if streak == _STREAK:
                streak = 0
                count = _run(data, position, end, size)
                messages.add_run(position + 9, size, count)
                position += count * (9 + size)
        elif opcode in _KEPT:
            others.append((opcode, content, size))
            if opcode == FOOTER:
                break
    return Scan(*messages.arrays(), tuple(others), position, cut, damage)


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


def chunk_fields(data: Bytes, start: int, size: int, *, torn: bool = False) -> tuple[int, int, str, memoryview]:
    """Return what a Chunk record holds: unpacked size, CRC-32 of that (0: none), compression, the packed records.

    Damaged where it contradicts itself. torn: the record is cut, and so are the packed records.
    """
    fields = Fields(data, start, size)
    fields.take(16)
    unpacked, checksum, compression = fields.number(8), fields.number(4), fields.text()
    announced = fields.number(8)
    packed = fields.take(min(announced, fields.end - fields.position) if torn else announced)
    return unpacked, checksum, compression, packed
