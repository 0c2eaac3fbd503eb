"""Positions of one topic with the efforts that a robot's driver puts elsewhere: other topics, other fields, arrays."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from robot_ident.bags.cdr import numbers_of
from robot_ident.bags.joint_states import JointStateDecoder, Piece, assemble, usual_delay
from robot_ident.bags.storage import NUMBERS, Integers, Storage, one_line
from robot_ident.bags.topics import choose_topic, listing, named_topic
from robot_ident.errors import InputError
from robot_ident.recording.effort import EffortSeries
from robot_ident.recording.recording import Recording
from robot_ident.robot.drives import EffortSource
from robot_ident.signals.motion import Array


def with_efforts(
    storage: Storage,
    source: str,
    topic: str | None,
    sources: Mapping[str, EffortSource],
    joints: Sequence[str],
    wanted: Sequence[str] | None = None,
) -> Recording:
    """Return positions of one topic with the efforts that stand elsewhere, by joint in `sources`.

    Efforts are interpolated at the positions' stamps, linearly; positions without any beside them are left out. Those
    without a header count from their receipt, less the usual delay of the positions. source: the storage's name in
    messages. topic: of the positions, None: the only one that may be it. joints: the robot's. wanted: those of the
    recording, None: all that the positions' topic reports together. InputError where a place holds no effort.
    """
    chosen = choose_topic(storage, source, topic)
    name = storage.topics[chosen].name
    told = {joint: replace(one, topic=one.topic or name) for joint, one in sources.items()}
    beside = {one.field for one in told.values() if one.topic and one.topic.strip("/") == name.strip("/")}
    if "position" in beside:
        raise InputError(f"{source}: effort.field = position: topic {one_line(name)} holds the positions themselves")
    states = _pieces(storage, chosen)
    filled = [_room_for_effort(piece, told, joints) for piece in states]
    positions = assemble(filled, wanted, source, name, storage.notes, listing(storage))
    delay = usual_delay(*(np.concatenate([getattr(piece, which) for piece in states]) for which in ("stamp", "log")))

    @cache
    def pieces_of(beside: str) -> list[Piece]:
        return _pieces(storage, named_topic(storage, source, beside))

    @cache
    def tables_of(beside: str) -> list[tuple[Integers, Array]]:
        index = named_topic(storage, source, beside, NUMBERS)
        return [numbers_of(batch) for batch in storage.batches([index])]

    tau, kept = positions.tau.copy(), np.ones(positions.samples, dtype=bool)
    used = {joint: one for joint, one in told.items() if joint in positions.names}
    for joint, place in used.items():
        if place.index is None:
            parts = list(_of_joint(pieces_of(place.topic or name), joint, place.field, delay))
        else:
            tables = [(log, table) for log, table in tables_of(place.topic or name) if table.shape[1] > place.index]
            parts = [(log - delay, table[:, place.index]) for log, table in tables]
        series = _joined(parts, source, place, joint)
        tau[:, positions.names.index(joint)], there = series.at(positions.t, positions.start_ns)
        kept &= there
    notes = [*positions.notes, *_said(used, name)]
    if not kept.any():
        raise InputError(
            f"{source}: no position of topic {one_line(name)} has an effort at its time; {listing(storage)}"
        )
    if not kept.all():
        notes.append(f"{int((~kept).sum())} of {len(kept)} positions have no effort at their time and are left out")
    whole = replace(positions, tau=tau, dq=None if "velocity" in beside else positions.dq)[kept]
    return replace(whole, notes=tuple(notes))


def _pieces(storage: Storage, index: int) -> list[Piece]:
    decoder = JointStateDecoder()
    return [piece for batch in storage.batches([index]) for piece in decoder.decode(batch)]


def _room_for_effort(piece: Piece, elsewhere: Collection[str], joints: Sequence[str]) -> Piece:
    """Return messages with zeros in place of efforts that stand elsewhere, of some joints or of all."""
    if set(joints) <= set(elsewhere):
        return replace(piece, effort=np.zeros_like(piece.position))
    if piece.effort.shape[1] != len(piece.names):
        return piece
    return replace(piece, effort=np.where([name in elsewhere for name in piece.names], 0.0, piece.effort))


def _said(used: Mapping[str, EffortSource], states: str) -> list[str]:
    """Return a line for each topic that efforts were taken from."""
    out = []
    for topic in dict.fromkeys(one.topic for one in used.values()):
        joints = {joint: one.field for joint, one in used.items() if one.topic == topic}
        fields = ", ".join(dict.fromkeys(joints.values()))
        out.append(one_line(f"effort of {', '.join(joints)} is {fields} of {topic}, at the stamps of {states}"))
    return out


def _of_joint(pieces: Sequence[Piece], joint: str, field: str, delay: int) -> Iterator[tuple[Integers, Array]]:
    """Yield stamps and values of one joint; delay: from a stamp to the receipt, which stands in where there is none."""
    for piece in pieces:
        values: Array = getattr(piece, field)
        if joint in piece.names and values.shape[1] == len(piece.names):
            stamp = np.where(piece.stamp == 0, piece.log - delay, piece.stamp)
            yield stamp, values[:, piece.names.index(joint)]


def _joined(parts: Sequence[tuple[Integers, Array]], source: str, place: EffortSource, joint: str) -> EffortSeries:
    """Return the parts as one series in order of time, numbers only and each stamp once."""
    stamp = np.concatenate([part[0] for part in parts]) if parts else np.zeros(0, dtype=np.int64)
    value = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0)
    there = np.isfinite(value)
    stamp, first = np.unique(stamp[there], return_index=True)
    if not len(stamp):
        raise InputError(
            f"{source}: topic {place.topic} holds no number for the effort of {joint} in field {place.field};"
            " the robot YAML's effort.topic and effort.field say where it stands"
        )
    return EffortSeries(stamp, value[there][first])
