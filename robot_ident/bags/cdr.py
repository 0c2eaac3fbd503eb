"""The CDR bytes of sensor_msgs/msg/JointState and std_msgs/msg/Float64MultiArray: where each value stands, and how to
read and write many messages at once.

CDR (OMG, formal/02-06-51) as DDS carries it: two bytes name the representation, two are options, then the body. In the
body every number is aligned to its size, counted from the body's first byte; a string is its length with the closing
zero, its bytes and the zero; a sequence is its length and its elements, unpadded where it is empty. An array message is
its layout (a sequence of dimensions, each a label and two uint32; a uint32 offset), then the sequence of numbers.
"""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from robot_ident.bags.storage import JOINT_STATE, Batch, Bytes, Integers, decompressed
from robot_ident.signals.motion import Array

ENCAPSULATION = 4  # bytes before the body
# representation -> (byte order, widest alignment): XCDR1 as ROS 2 writes it, XCDR2 as other DDS clients may
REPRESENTATIONS = {0x0000: (">", 8), 0x0001: ("<", 8), 0x0006: (">", 4), 0x0007: ("<", 4)}
_STAMP = 8  # bytes: int32 s, uint32 ns
_SLACK = 32  # bytes that may follow: rmw_fastrtps reserves room before empty sequences and sends it with the message


class NotCdr(ValueError):
    """Bytes that are no JointState."""


@dataclass(frozen=True)
class Layout:
    """Where the values of a JointState stand in its body; the same for all that match `template`.

    names: the joints. order: byte order. position, velocity, effort: first byte and number of values. template, mask
    [words]: the body's fixed bytes (names, lengths, frame id) as 64-bit words; mask is zero over stamps, values and
    padding.
    """

    names: tuple[str, ...]
    order: str
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

    def __init__(self, body: bytes, representation: int) -> None:
        if representation not in REPRESENTATIONS:
            raise NotCdr(f"representation {representation:#06x} is not plain CDR")
        self.body = body
        self.order, self.widest = REPRESENTATIONS[representation]
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
    cursor = _Cursor(body, representation)
    cursor.take(_STAMP, 4, fixed=False)
    cursor.text()  # frame_id
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
    return Layout(names, cursor.order, position, velocity, effort, template, mask.view(np.uint64))


@cache
def message_types() -> Any:
    """Return the definitions of the messages of ROS 2 Jazzy, a `rosbags.typesys` store."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def serialise(
    names: tuple[str, ...],
    stamps: Integers,
    position: Array | None,
    velocity: Array | None,
    effort: Array | None,
) -> Bytes:
    """Return N JointStates as rows of bytes [N, size], encapsulation included (little-endian XCDR1, as ROS 2 writes).

    stamps [N] ns. position, velocity, effort [N, n], or None for an empty sequence.
    """
    store = message_types()
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](0, 0), "")
    fields = (position, velocity, effort)
    zeros = [np.zeros(0 if values is None else values.shape[1]) for values in fields]
    message = bytes(store.serialize_cdr(store.types[JOINT_STATE](header, list(names), *zeros), JOINT_STATE))
    layout = layout_of(message[ENCAPSULATION:], 1)
    rows = np.tile(np.frombuffer(message, dtype=np.uint8), (len(stamps), 1))
    inner = rows[:, ENCAPSULATION:]
    seconds, nanoseconds = np.divmod(np.asarray(stamps, dtype=np.int64), 1_000_000_000)
    inner[:, 0:4] = seconds.astype("<i4")[:, None].view(np.uint8)
    inner[:, 4:8] = nanoseconds.astype("<u4")[:, None].view(np.uint8)
    for values, (first, length) in zip(fields, (layout.position, layout.velocity, layout.effort), strict=True):
        if length:
            inner[:, first : first + 8 * length] = np.ascontiguousarray(values, dtype="<f8").view(np.uint8)
    return rows


def numbers_of(batch: Batch) -> tuple[Integers, Array]:
    """Return receive times [k] ns and numbers [k, longest] of the messages that can be read, nan where one is short."""
    found: dict[int, Array] = {}
    for k in range(len(batch)):
        with suppress(NotCdr):
            found[k] = _numbers(decompressed(batch.payload(k)))
    table = np.full((len(found), max(map(len, found.values()), default=0)), np.nan)
    for row, values in zip(table, found.values(), strict=True):
        row[: len(values)] = values
    return batch.log_time[list(found)], table


def _numbers(message: bytes) -> Array:
    """Return the numbers of one array message; NotCdr where these bytes are none."""
    cursor = _Cursor(message[ENCAPSULATION:], int.from_bytes(message[:2], "big"))
    for _ in range(cursor.length()):
        cursor.text()
        cursor.take(8, 4, fixed=True)
    cursor.length()  # the offset
    first, count = cursor.numbers()
    return np.array(struct.unpack_from(f"{cursor.order}{count}d", cursor.body, first))
