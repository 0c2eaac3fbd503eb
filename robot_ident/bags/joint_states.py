"""Makes one recording of raw JointState messages: joints by name, one clock, samples in order.

Almost every recording repeats the same names, lengths and frame id byte for byte, so that the numbers stand in the same
places of every message and are read as columns of one table. Whether that holds is checked on every message. A layout
that changes in mid-bag (another order of joints, a second publisher, a missing velocity) begins a new table.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from robot_ident.bags.cdr import ENCAPSULATION, Layout, NotCdr, layout_of
from robot_ident.bags.storage import ZSTD_MAGIC, Batch, Bytes, Integers, decompressed, one_line, windows
from robot_ident.errors import InputError, did_you_mean
from robot_ident.recording.recording import Recording
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

    velocities: False leaves them out, as if none were reported.
    unreadable: how many messages were no JointState, with the reason for the first.
    """

    velocities: bool = True
    unreadable: int = 0
    reason: str = ""
    _seen: int = 0
    _layouts: dict[tuple[int, int], list[Layout]] = field(default_factory=lambda: defaultdict(list))

    def decode(self, batch: Batch) -> Iterator[Piece]:
        """Yield the messages of one topic in pieces of equal layout."""
        index = np.arange(self._seen, self._seen + len(batch), dtype=np.int64)
        self._seen += len(batch)
        if len(batch) and batch.payload(0)[:4] == ZSTD_MAGIC:
            payloads = [decompressed(batch.payload(number)) for number in range(len(batch))]
            batch = Batch.of(payloads, batch.topic, batch.log_time, batch.publish_time)
        long_enough = batch.size >= ENCAPSULATION
        if not long_enough.all():
            self._refuse(int((~long_enough).sum()), "it has less than 4 bytes")
            batch, index = batch.pick(long_enough), index[long_enough]
        kinds = batch.size << 16 | windows(batch.data, batch.start, 2).view(">u2")[:, 0]
        alike = len(kinds) > 0 and bool(np.all(kinds == kinds[0]))  # the usual case, which needs no sorting
        for kind in (kinds[:1] if alike else np.unique(kinds)).tolist():
            rows = slice(None) if alike else np.flatnonzero(kinds == kind)
            yield from self._decode_equal(batch.pick(rows), index[rows], (kind >> 16) - ENCAPSULATION, kind & 0xFFFF)

    def _decode_equal(self, batch: Batch, index: Integers, size: int, code: int) -> Iterator[Piece]:
        """Yield the pieces of messages that have the same size and representation."""
        bodies = windows(batch.data, batch.start + ENCAPSULATION, size, -(-max(size, 1) // 8) * 8)
        known = self._layouts[size, code]
        rest, number = np.arange(len(batch)), 0
        while len(rest) and number < _MOST_LAYOUTS:
            if number == len(known):
                layout = self._layout_of(bodies[rest[0], :size], code)
                if layout is None:
                    rest = rest[1:]
                    continue
                known.append(layout)
            same = known[number].matches(bodies[rest] if len(rest) < len(bodies) else bodies)
            if same.any():
                rows = rest[same]
                alike = bodies[rows] if len(rows) < len(bodies) else bodies
                yield self._piece(known[number], alike, index[rows], batch.log_time[rows])
                rest = rest[~same]
            number += 1
        # the layouts of the others are looked up singly; what agrees in names and lengths is joined
        agreeing: dict[tuple[object, ...], list[Piece]] = defaultdict(list)
        for row in rest:
            layout = self._layout_of(bodies[row, :size], code)
            if layout is not None:
                piece = self._piece(layout, bodies[[row]], index[[row]], batch.log_time[[row]])
                agreeing[layout.names, layout.position[1], piece.velocity.shape[1], layout.effort[1]].append(piece)
        for pieces in agreeing.values():
            yield _joined(pieces)

    def _layout_of(self, body: Bytes, code: int) -> Layout | None:
        """Return the layout of one body, None where it is no JointState, which is counted."""
        try:
            return layout_of(body.tobytes(), code)
        except NotCdr as error:
            self._refuse(1, str(error))
            return None

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
    columns = ("index", "stamp", "log", "position", "velocity", "effort")
    return Piece(pieces[0].names, *(np.concatenate([getattr(piece, name) for piece in pieces]) for name in columns))


_BURSTS = 0.1  # of the samples: as many that come with another are no accident
_OWN_DELAY = 1000  # ns by which the delays of messages differ that were received
_SHORTEST = 1e9  # ns over which the pace of clocks shows
_CLOSE = 0.05  # of the long steps between stamps: what is nearer came in one burst
_LONGEST = 100  # samples of a burst
_BACKWARDS = 0.9  # of the steps between stamps: nothing that is late now and then goes back as often


@dataclass(frozen=True)
class Samples:
    """Samples before they are a recording: stamps [N] (ns, or s as a float), q, tau and perhaps dq [N, n]."""

    stamp: NDArray[np.int64] | Array
    q: Array
    tau: Array
    dq: Array | None = None

    def __getitem__(self, rows: NDArray[np.generic]) -> Samples:
        """Return some of the samples, or all in another order."""
        return Samples(self.stamp[rows], self.q[rows], self.tau[rows], None if self.dq is None else self.dq[rows])


def in_order(samples: Samples, place: str) -> tuple[Samples, list[str]]:
    """Sort by stamp, drop what came twice, spread what came in bursts; say each in notes.

    InputError that names `place` where all stamps are the same.
    """
    notes: list[str] = []
    stamp = samples.stamp
    if len(stamp) < 2:
        return samples, notes
    if np.all(stamp == stamp[0]):
        raise InputError(f"{place}: all of its {len(stamp)} samples have the same time")
    if np.mean(np.diff(stamp) < 0) > _BACKWARDS:
        raise InputError(
            f"{place}: its times run backwards, from {_seconds(stamp[0])} to {_seconds(stamp[-1])} s; sort its rows by"
            " time where each stands beside its own, or turn the times round where they alone are reversed"
        )
    if not np.all(np.diff(stamp) > 0):
        late = int(np.sum(stamp[1:] < np.maximum.accumulate(stamp)[:-1]))
        if late:
            notes.append(f"{late} of {len(stamp)} samples came later than their stamps say and were sorted")
            samples = samples[np.argsort(stamp, kind="stable")]
        samples = _once(samples, notes)
    follows = _bursts(samples.stamp)
    if follows.any():
        notes.append(f"{int(follows.sum())} samples came in bursts; they are spread over the time since the last one")
        return _spread(samples, follows), notes
    follows = _held_up(samples.stamp)
    if follows.any():
        notes.append(f"{int(follows.sum())} samples came late, with the stamp of another; they are spread over the gap")
        samples = _spread(samples, follows)
    again = np.concatenate([[False], np.diff(samples.stamp) == 0])
    if not again.any():
        return samples, notes
    notes.append(f"{int(again.sum())} samples have the stamp of another with different content; the first one is kept")
    return samples[~again], notes


def _seconds(stamp: float | np.int64) -> str:
    return f"{float(stamp) / (1e9 if isinstance(stamp, np.int64) else 1.0):.3f}"


def _once(samples: Samples, notes: list[str]) -> Samples:
    """Return sorted samples without those that equal their predecessor, stamp and content."""
    again = np.concatenate([[False], np.diff(samples.stamp) == 0])
    rows = np.flatnonzero(again)
    equal = np.all(samples.q[rows] == samples.q[rows - 1], axis=1)
    equal &= np.all(samples.tau[rows] == samples.tau[rows - 1], axis=1)
    again[rows[~equal]] = False
    if not again.any():
        return samples
    notes.append(f"{int(again.sum())} samples came again with the same stamp and content; dropped")
    return samples[~again]


def _bursts(stamp: NDArray[np.int64] | Array) -> NDArray[np.bool_]:
    """Return which samples [N] come with the one before, in a burst; none where that is rare.

    Steps far below the usual long ones, in short runs: two sample rates in one recording make long runs.
    """
    none = np.zeros(len(stamp), dtype=bool)
    if len(stamp) < 20:
        return none
    steps = np.diff(stamp)
    follows = np.concatenate([[False], steps < _CLOSE * np.percentile(steps, 95.0)])
    if follows.mean() < _BURSTS:
        return none
    edges = np.flatnonzero(~follows)
    return follows if np.diff(edges, append=len(stamp)).max() <= _LONGEST else none


def _held_up(stamp: NDArray[np.int64] | Array) -> NDArray[np.bool_]:
    """Return which samples [N] share the stamp of the one before because both were held up: a gap before them has room
    for all that share it. Where there is none, the sample came twice.
    """
    follows = np.concatenate([[False], np.diff(stamp) == 0])
    if len(stamp) < 20 or not follows.any():
        return np.zeros(len(stamp), dtype=bool)
    group = np.cumsum(~follows) - 1
    size = np.bincount(group)
    gap = np.diff(stamp[~follows], prepend=stamp[0])
    room = np.rint(gap / np.median(gap[1:])) >= size
    return follows & room[group]


def _spread(samples: Samples, follows: NDArray[np.bool_]) -> Samples:
    """Return samples whose bursts, stamped when they arrived, are spread evenly since the stamp before.

    The first burst takes the pace of the next.
    """
    start = samples.stamp[0]
    burst = np.cumsum(~follows) - 1
    size = np.bincount(burst)
    first = np.cumsum(size) - size
    stamp = (samples.stamp - start)[first]
    length = np.diff(stamp, prepend=stamp[0] - (stamp[1] - stamp[0]) * (size[0] / size[1]))
    since = stamp[burst] - length[burst] * (1.0 - (np.arange(len(burst)) - first[burst] + 1.0) / size[burst])
    even = np.asarray(since if samples.stamp.dtype.kind == "f" else np.rint(since).astype(np.int64))
    return replace(samples, stamp=even + start)


def assemble(
    pieces: list[Piece],
    joints: Sequence[str] | None,
    source: str,
    topic: str,
    losses: Sequence[str] = (),
    listing: str = "",
) -> Recording:
    """Return the recording of all messages that report position and effort of the joints.

    pieces: emptied, so that their memory is free while the arrays of the recording grow. joints: those wanted, in this
    order; None takes the set of joints that fills most of the topic. losses: what the bag
    lacks, for the notes. listing: the bag's topics, for the line that says that this one has no efforts. InputError
    when a joint is missing, no message has efforts, or a message contradicts itself.
    """
    place = f"{source}: topic {one_line(topic)}"
    for piece in pieces:
        for part in ("position", "velocity", "effort"):
            length = getattr(piece, part).shape[1]
            if length not in (0, len(piece.names)):
                raise InputError(
                    f"{place}, message {int(piece.index[0]) + 1}: {part} has {length} values for "
                    f"{len(piece.names)} joints ({one_line(*piece.names) or 'no names'})"
                )
    with_efforts = [piece for piece in pieces if piece.names and piece.effort.shape[1] and piece.position.shape[1]]
    if not with_efforts:
        lacking = "positions" if any(piece.effort.shape[1] for piece in pieces) else "efforts"
        raise InputError(
            f"{place} reports no {lacking} in any of its {_size(pieces)} messages{f'; {listing}' if listing else ''}"
        )
    names = _choose_joints(with_efforts, joints, place)
    used = [_only(piece, names) for piece in with_efforts if set(names) <= set(piece.names)]
    notes = [*losses, *_left_out(pieces, used, names)]
    del with_efforts
    pieces.clear()
    stamp, log = (np.concatenate([getattr(piece, name) for piece in used]) for name in ("stamp", "log"))
    pace = _pace(stamp, log)
    stamp, clock_notes = _one_clock(stamp, log)
    samples, velocity_notes = _join(used, stamp)
    names, samples, silent_notes = _without_silent(names, samples, joints, place)
    samples, order_notes = in_order(samples, place)
    start = int(samples.stamp[0])
    t = (samples.stamp - start) / 1e9
    notes += clock_notes + velocity_notes + silent_notes + order_notes
    for values in (t, samples.q, samples.tau, samples.dq):
        if values is not None:
            values.setflags(write=False)  # made here for this recording, which then needs no copy
    return Recording(names, t, samples.q, samples.tau, samples.dq, source, tuple(notes), start, pace=pace)


def _join(used: list[Piece], stamp: Integers) -> tuple[Samples, list[str]]:
    """Return the samples of all pieces in the order in which they were recorded; `used` is emptied."""
    velocity, notes = _velocity(used)
    index = np.concatenate([piece.index for piece in used])
    positions, efforts = [piece.position for piece in used], [piece.effort for piece in used]
    used.clear()
    position = np.concatenate(positions)
    positions.clear()
    samples = Samples(stamp, position, np.concatenate(efforts), velocity)
    return samples[np.argsort(index)] if np.any(np.diff(index) < 0) else samples, notes


def _pace(stamp: Integers, log: Integers) -> float | None:
    """Return how much time the receive times span while the header stamps span a second; None where they say nothing
    of their own, as in a bag that was made of stamps.
    """
    if not stamp.any():
        return 1.0
    stamp, log = stamp[stamp != 0], log[stamp != 0]
    delay = log - stamp
    few = max(1, len(stamp) // 20)
    spans = [float(np.median(x[-few:] - x[0]) - np.median(x[:few] - x[0])) for x in (log, stamp)]
    if np.ptp(delay) < _OWN_DELAY or spans[1] < _SHORTEST:
        return None
    return spans[0] / spans[1]


def _size(pieces: Sequence[Piece]) -> int:
    return sum(len(piece.index) for piece in pieces)


def _choose_joints(pieces: Sequence[Piece], joints: Sequence[str] | None, place: str) -> tuple[str, ...]:
    if joints is None:
        values: Counter[tuple[str, ...]] = Counter()
        for piece in pieces:
            values[tuple(sorted(piece.names))] += len(piece.index) * len(piece.names)
        fullest = set(values.most_common(1)[0][0])
        return next(tuple(dict.fromkeys(piece.names)) for piece in pieces if set(piece.names) == fullest)
    there = list(dict.fromkeys(name for piece in pieces for name in piece.names))
    for name in joints:
        if name not in there:
            raise InputError(
                f"{place}: joint {name!r} is missing{did_you_mean(name, there)}; the recording has {one_line(*there)}"
            )
    if not any(set(joints) <= set(piece.names) for piece in pieces):
        raise InputError(f"{place}: the joints {', '.join(joints)} never come in one message; choose those that do")
    return tuple(joints)


def _only(piece: Piece, names: tuple[str, ...]) -> Piece:
    """Return the columns of `names`, in that order."""
    if piece.names == names:
        return piece
    columns = [piece.names.index(name) for name in names]
    velocity = piece.velocity[:, columns] if piece.velocity.shape[1] else piece.velocity
    return replace(
        piece, names=names, position=piece.position[:, columns], velocity=velocity, effort=piece.effort[:, columns]
    )


def _left_out(pieces: Sequence[Piece], used: Sequence[Piece], names: tuple[str, ...]) -> list[str]:
    """Say how many messages were not used, and which joints they had."""
    unused = _size(pieces) - _size(used)
    if not unused:
        return []
    others = sorted({name for piece in pieces if not set(names) <= set(piece.names) for name in piece.names})
    what = f"of other joints ({one_line(*others)})" if others else "without positions or efforts"
    return [f"{unused} of {_size(pieces)} messages {what} are left out"]


def _one_clock(stamp: Integers, log: Integers) -> tuple[Integers, list[str]]:
    """Header stamps rule; where they are zero the receive time stands in, less the usual delay of the others."""
    zero = stamp == 0
    if not zero.any():
        return stamp, []
    if zero.all():
        return log, ["no message has a header stamp: the receive time is used"]
    delay = usual_delay(stamp, log)
    few = f"{int(zero.sum())} of {len(stamp)} messages have no header stamp"
    return np.where(zero, log - delay, stamp), [f"{few}: their receive time less {delay / 1e9:.6f} s is used"]


def usual_delay(stamp: Integers, log: Integers) -> int:
    """Return the usual time [ns] from a header's stamp to the receipt of its message, 0 where there are no stamps."""
    late = (log - stamp)[stamp != 0]
    return int(late[0]) + int(np.median(late - late[0])) if len(late) else 0  # epochs as float64 would lose nanoseconds


def _without_silent(
    names: tuple[str, ...], samples: Samples, joints: Sequence[str] | None, place: str
) -> tuple[tuple[str, ...], Samples, list[str]]:
    """Leave out joints whose effort is never a number (drivers report NaN where there is no sensor)."""
    silent = [name for name, column in zip(names, samples.tau.T, strict=True) if np.isnan(column).all()]
    if not silent:
        return names, samples, []
    if joints is not None or len(silent) == len(names):
        count = len(samples.stamp)
        raise InputError(f"{place}: the effort of joint {silent[0]!r} is not a number in any of the {count} samples")
    keep = [number for number, name in enumerate(names) if name not in silent]
    dq = None if samples.dq is None else samples.dq[:, keep]
    fewer = Samples(samples.stamp, samples.q[:, keep], samples.tau[:, keep], dq)
    return tuple(names[k] for k in keep), fewer, [f"the effort of {one_line(*silent)} is never a number; left out"]


def _velocity(used: Sequence[Piece]) -> tuple[Array | None, list[str]]:
    """Return the reported velocities, or None where any is missing."""
    silent = [piece for piece in used if not piece.velocity.shape[1]]
    if len(silent) == len(used):
        return None, []
    if silent:
        return None, [f"velocity is missing in {_size(silent)} of {_size(used)} messages and is not used"]
    velocity: Array = np.concatenate([piece.velocity for piece in used])
    if np.isnan(velocity).all(axis=0).any():
        return None, ["the velocity of a joint is never a number; velocities are not used"]
    return velocity, []
