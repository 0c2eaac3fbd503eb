"""The CDR bytes of sensor_msgs/msg/JointState and std_msgs/msg/Float64MultiArray: where each value stands, and how to
read and write many messages at once.

CDR (OMG, formal/02-06-51) as DDS carries it: two bytes name the representation, two are options, then the body. In the
body every number is aligned to its size, counted from the body's first byte; a string is its length with the closing
zero, its bytes and the zero; a sequence is its length and its elements, unpadded where it is empty. An array message is
its layout (a sequence of dimensions, each a label and two uint32; a uint32 offset), then the sequence of numbers.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot_ident.bags import compression
from robot_ident.bags.storage import Batch, Bytes, Integers
from robot_ident.signals.motion import Array

ENCAPSULATION = 4  # bytes before the body
LITTLE_ENDIAN = b"\x00\x01\x00\x00"
# representation -> (byte order, widest alignment): XCDR1 as ROS 2 writes it, XCDR2 as other DDS clients may
REPRESENTATIONS = {0x0000: (">", 8), 0x0001: ("<", 8), 0x0006: (">", 4), 0x0007: ("<", 4)}
_STAMP = 8  # bytes: int32 s, uint32 ns
_SLACK = 32  # bytes that may follow: rmw_fastrtps reserves room before empty sequences and sends it with the message


class NotCdr(ValueError):
    """Bytes that are no JointState."""


@dataclass(frozen=True)
class Layout:
    """Where the values of a JointState stand in a body of `size` bytes; the same for all that match `template`.

    names: the joints. order: byte order. position, velocity, effort: first byte and number of values. template, mask
    [words]: the body's fixed bytes (names, lengths, frame id) as 64-bit words; mask is zero over stamps, values and
    padding.
    """

    names: tuple[str, ...]
    frame_id: str
    order: str
    size: int
    position: tuple[int, int]
    velocity: tuple[int, int]
    effort: tuple[int, int]
    template: NDArray[np.uint64]
    mask: NDArray[np.uint64]

    def matches(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which of the bodies [k, 8 words] have the same fixed bytes, and so the same layout."""
        columns = np.flatnonzero(self.mask)
        words = rows.view(np.uint64)[:, columns]
        unequal = (words ^ self.template[columns]) & self.mask[columns]
        return np.asarray(~unequal.any(axis=1))

    def stamps(self, rows: Bytes) -> Integers:
        """Return the header stamps [k] in ns."""
        seconds = np.ascontiguousarray(rows[:, :4]).view(f"{self.order}i4")[:, 0].astype(np.int64)
        nanoseconds = np.ascontiguousarray(rows[:, 4:8]).view(f"{self.order}u4")[:, 0].astype(np.int64)
        return seconds * 1_000_000_000 + nanoseconds

    def values(self, rows: Bytes, place: tuple[int, int]) -> Array:
        """Return one of the three sequences [k, length]."""
        first, length = place
        if not length:
            return np.zeros((len(rows), 0))  # a view of none would keep them all
        inside = np.ascontiguousarray(rows[:, first : first + 8 * length])
        return inside.view(f"{self.order}f8").astype(np.float64, copy=False).reshape(len(rows), length)


class _Cursor:
    """Walks through a body, and remembers which bytes are fixed."""

    def __init__(self, body: bytes, order: str, widest: int) -> None:
        self.body, self.order, self.widest = body, order, widest
        self.position = 0
        self.fixed: list[tuple[int, int]] = []

    def take(self, size: int, align: int, *, fixed: bool) -> int:
        first = -(-self.position // align) * align
        if size > len(self.body) - first:
            raise NotCdr(f"{size} bytes at {first} reach beyond the message's {len(self.body)}")
        if fixed:
            self.fixed.append((first, first + size))
        self.position = first + size
        return first

    def length(self) -> int:
        first = self.take(4, 4, fixed=True)
        return int(struct.unpack_from(f"{self.order}I", self.body, first)[0])

    def text(self) -> str:
        size = self.length()
        first = self.take(size, 1, fixed=True)
        return self.body[first : first + max(size - 1, 0)].decode("utf-8", errors="replace")

    def numbers(self) -> tuple[int, int]:
        length = self.length()
        first = self.take(8 * length, self.widest, fixed=False) if length else self.position
        return first, length


def layout_of(body: bytes, representation: int) -> Layout:
    """Return the layout of one JointState body; NotCdr when these bytes are none."""
    if representation not in REPRESENTATIONS:
        raise NotCdr(f"representation {representation:#06x} is not plain CDR")
    order, widest = REPRESENTATIONS[representation]
    cursor = _Cursor(body, order, widest)
    cursor.take(_STAMP, 4, fixed=False)
    frame_id = cursor.text()
    count = cursor.length()
    if 4 * count > len(body) - cursor.position:
        raise NotCdr(f"{count} names do not fit into {len(body)} bytes")
    names = tuple(cursor.text() for _ in range(count))
    position, velocity, effort = cursor.numbers(), cursor.numbers(), cursor.numbers()
    if len(body) - cursor.position > _SLACK:
        raise NotCdr(f"{len(body) - cursor.position} bytes follow the last field")
    words = -(-len(body) // 8)
    mask = np.zeros(8 * words, dtype=np.uint8)
    for first, end in cursor.fixed:
        mask[first:end] = 0xFF
    template = np.frombuffer(body.ljust(8 * words, b"\0"), dtype=np.uint64)
    return Layout(
        names, frame_id, order, len(body), position, velocity, effort, template, np.frombuffer(mask, dtype=np.uint64)
    )


def _pad(buffer: bytearray, align: int) -> None:
    buffer.extend(bytes(-len(buffer) % align))


def _text(buffer: bytearray, text: str) -> None:
    content = text.encode() + b"\0"
    _pad(buffer, 4)
    buffer += struct.pack("<I", len(content)) + content


def serialise(
    names: tuple[str, ...],
    stamps: Integers,
    position: Array | None = None,
    velocity: Array | None = None,
    effort: Array | None = None,
    frame_id: str = "",
) -> Bytes:
    """Return N JointStates as rows of bytes [N, size], encapsulation included (little-endian XCDR1, as ROS 2 writes).

    stamps [N] ns. position, velocity, effort [N, n], or None for an empty sequence.
    """
    body = bytearray(_STAMP)
    _text(body, frame_id)
    _pad(body, 4)
    body += struct.pack("<I", len(names))
    for name in names:
        _text(body, name)
    places: list[tuple[int, Array]] = []
    for values in (position, velocity, effort):
        _pad(body, 4)
        length = 0 if values is None else values.shape[1]
        body += struct.pack("<I", length)
        if values is not None and length:
            _pad(body, 8)
            places.append((len(body), values))
            body += bytes(8 * length)
    rows = np.tile(np.frombuffer(LITTLE_ENDIAN + bytes(body), dtype=np.uint8), (len(stamps), 1))
    inner = rows[:, ENCAPSULATION:]
    seconds, nanoseconds = np.divmod(np.asarray(stamps, dtype=np.int64), 1_000_000_000)
    inner[:, 0:4] = seconds.astype("<i4")[:, None].view(np.uint8)
    inner[:, 4:8] = nanoseconds.astype("<u4")[:, None].view(np.uint8)
    for first, values in places:
        inner[:, first : first + 8 * values.shape[1]] = np.ascontiguousarray(values, dtype="<f8").view(np.uint8)
    return rows


def numbers_of(batch: Batch) -> tuple[Integers, Array]:
    """Return receive times [k] ns and numbers [k, longest] of the messages that can be read, nan where one is short."""
    rows = [_numbers(compression.message(batch.payload(k))) for k in range(len(batch))]
    readable = [k for k, row in enumerate(rows) if row is not None]
    longest = max((len(row) for row in rows if row is not None), default=0)
    table = np.full((len(readable), longest), np.nan)
    for place, k in enumerate(readable):
        row = rows[k]
        if row is not None:
            table[place, : len(row)] = row
    return batch.log_time[readable], table


def _numbers(message: bytes) -> Array | None:
    """Return the numbers of one message, None where these bytes are none."""
    representation = int.from_bytes(message[:2], "big")
    if len(message) < ENCAPSULATION or representation not in REPRESENTATIONS:
        return None
    order, widest = REPRESENTATIONS[representation]
    body = message[ENCAPSULATION:]
    try:
        (dimensions,) = struct.unpack_from(f"{order}I", body, 0)
        at = 4
        for _ in range(dimensions):
            (label,) = struct.unpack_from(f"{order}I", body, at)
            at = -(-(at + 4 + label) // 4) * 4 + 8
            struct.unpack_from(f"{order}I", body, at - 4)  # ends a count that the body can't hold
        (count,) = struct.unpack_from(f"{order}I", body, at + 4)
        first = -(-(at + 8) // widest) * widest
        return np.array(struct.unpack_from(f"{order}{count}d", body, first)) if count else np.zeros(0)
    except struct.error:
        return None
