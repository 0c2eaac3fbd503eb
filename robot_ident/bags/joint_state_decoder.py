"""Turns raw JointState messages into arrays: many at once while their layout stays, one by one where it does not.

Almost every recording repeats the same names, lengths and frame id byte for byte, so that the numbers stand in the same
places of every message and are read as columns of one table. Whether that holds is checked on every message. A layout
that changes in mid-bag (another order of joints, a second publisher, a missing velocity) begins a new table.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from robot_ident.bags import compression
from robot_ident.bags.cdr import ENCAPSULATION, Layout, NotCdr, layout_of
from robot_ident.bags.storage import Batch, Bytes, Integers, windows
from robot_ident.signals.motion import Array

_MOST_LAYOUTS = 32  # per message size; a bag with more (a counter in the frame id, say) is read one by one


@dataclass(frozen=True)
class Piece:
    """k messages of one publisher: the same joints in the same order, the same fields.

    names: the joints. index [k]: the messages' numbers within their topic. stamp, log [k] ns: header stamp and receive
    time. position, velocity, effort [k, length], where length is 0 for a field that is missing.
    """

    names: tuple[str, ...]
    index: Integers
    stamp: Integers
    log: Integers
    position: Array
    velocity: Array
    effort: Array


@dataclass
class JointStateDecoder:
    """Decodes batch after batch; remembers the layouts that it met.

    vectorised: False reads every message by itself. velocities: False leaves them out, as if none were reported.
    unreadable: how many messages were no JointState, with the reason for the first.
    """

    vectorised: bool = True
    velocities: bool = True
    unreadable: int = 0
    reason: str = ""
    _seen: int = 0
    _layouts: dict[tuple[int, int], list[Layout]] = field(default_factory=lambda: defaultdict(list))

    def decode(self, batch: Batch) -> Iterator[Piece]:
        """Yield the messages of one topic in pieces of equal layout."""
        index = np.arange(self._seen, self._seen + len(batch), dtype=np.int64)
        self._seen += len(batch)
        if len(batch) and batch.payload(0)[:4] == compression.ZSTD_MAGIC:
            batch = _decompressed(batch)
        long_enough = batch.size >= ENCAPSULATION
        if not long_enough.all():
            self._refuse(int((~long_enough).sum()), "it has less than 4 bytes")
            batch, index = batch.pick(long_enough), index[long_enough]
        if not len(batch):
            return
        codes = windows(batch.data, batch.start, 2).view(">u2")[:, 0].astype(np.int64)
        if np.all(batch.size == batch.size[0]) and np.all(codes == codes[0]):
            yield from self._decode_equal(batch, index, int(batch.size[0]) - ENCAPSULATION, int(codes[0]))
            return
        kinds = batch.size << 16 | codes
        for kind in np.unique(kinds).tolist():
            rows = np.flatnonzero(kinds == kind)
            yield from self._decode_equal(batch.pick(rows), index[rows], (kind >> 16) - ENCAPSULATION, kind & 0xFFFF)

    def _decode_equal(self, batch: Batch, index: Integers, size: int, code: int) -> Iterator[Piece]:
        """Yield the pieces of messages that have the same size and representation."""
        bodies = windows(batch.data, batch.start + ENCAPSULATION, size, -(-max(size, 1) // 8) * 8)
        known = self._layouts[size, code]
        rest = np.arange(len(batch))
        for number in range(_MOST_LAYOUTS if self.vectorised else 0):
            if not len(rest):
                return
            if number == len(known):
                layout, rest = self._next_layout(bodies, rest, size, code)
                if layout is None:
                    return
                known.append(layout)
            same = known[number].matches(bodies[rest] if len(rest) < len(bodies) else bodies)
            if same.any():
                rows = rest[same]
                alike = bodies[rows] if len(rows) < len(bodies) else bodies
                yield self._piece(known[number], alike, index[rows], batch.log_time[rows])
                rest = rest[~same]
        yield from self._one_by_one(bodies, rest, index, batch.log_time, size, code)

    def _next_layout(self, bodies: Bytes, rest: Integers, size: int, code: int) -> tuple[Layout | None, Integers]:
        """Return the layout of the first readable message among `rest`, and `rest` without the unreadable before it."""
        for number, row in enumerate(rest):
            try:
                return layout_of(bodies[row, :size].tobytes(), code), rest[number:]
            except NotCdr as error:
                self._refuse(1, str(error))
        return None, rest[:0]

    def _one_by_one(
        self, bodies: Bytes, rest: Integers, index: Integers, log: Integers, size: int, code: int
    ) -> Iterator[Piece]:
        """Yield messages whose layout is looked up singly, joined where names and lengths agree."""
        alike: dict[tuple[object, ...], list[Piece]] = defaultdict(list)
        for row in rest:
            try:
                layout = layout_of(bodies[row, :size].tobytes(), code)
            except NotCdr as error:
                self._refuse(1, str(error))
                continue
            piece = self._piece(layout, bodies[row : row + 1], index[row : row + 1], log[row : row + 1])
            alike[layout.names, layout.position[1], piece.velocity.shape[1], layout.effort[1]].append(piece)
        for pieces in alike.values():
            yield _joined(pieces)

    def _piece(self, layout: Layout, rows: Bytes, index: Integers, log: Integers) -> Piece:
        return Piece(
            layout.names,
            index,
            layout.stamps(rows),
            log.copy(),  # a view would keep the batch's other columns
            layout.values(rows, layout.position),
            layout.values(rows, layout.velocity if self.velocities else (0, 0)),
            layout.values(rows, layout.effort),
        )

    def _refuse(self, messages: int, reason: str) -> None:
        self.unreadable += messages
        self.reason = self.reason or reason


def _joined(pieces: list[Piece]) -> Piece:
    return Piece(
        pieces[0].names,
        np.concatenate([piece.index for piece in pieces]),
        np.concatenate([piece.stamp for piece in pieces]),
        np.concatenate([piece.log for piece in pieces]),
        np.concatenate([piece.position for piece in pieces]),
        np.concatenate([piece.velocity for piece in pieces]),
        np.concatenate([piece.effort for piece in pieces]),
    )


def _decompressed(batch: Batch) -> Batch:
    """Return the batch with each message's own zstd frame unpacked."""
    payloads = [compression.message(batch.payload(number)) for number in range(len(batch))]
    size = np.array([len(payload) for payload in payloads], dtype=np.int64)
    data = np.frombuffer(bytearray().join(payloads), dtype=np.uint8)
    return Batch(data, np.cumsum(size) - size, size, batch.topic, batch.log_time, batch.publish_time)
