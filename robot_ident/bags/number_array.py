"""Decodes std_msgs/msg/Float64MultiArray: the numbers of many messages as one table.

The body: layout (a sequence of dimensions, each a label and two uint32; a uint32 offset), then the sequence of numbers.
"""

from __future__ import annotations

import struct

import numpy as np

from robot_ident.bags import compression
from robot_ident.bags.cdr import ENCAPSULATION, REPRESENTATIONS
from robot_ident.bags.storage import Batch, Integers
from robot_ident.signals.motion import Array


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
