"""Reads a recording as a robot declares it: positions from the joint states, effort from where its driver puts it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robot_ident.bags.assemble import assemble
from robot_ident.bags.forms import TABLES, form_of, open_storage
from robot_ident.bags.joint_state_decoder import JointStateDecoder, Piece
from robot_ident.bags.number_array import numbers_of
from robot_ident.bags.read import read_recording
from robot_ident.bags.storage import NUMBERS, Integers, Storage, one_line
from robot_ident.bags.topics import choose_topic, listing, named_topic
from robot_ident.errors import InputError
from robot_ident.motion import Array
from robot_ident.recording.conditions import read_conditions
from robot_ident.recording.recording import Recording
from robot_ident.robot import Robot
from robot_ident.robot.effort import EffortSource

_GAP = 5.0  # times the usual step between two efforts: what lies further apart is not interpolated


def read_for(path: Path | str, robot: Robot, *, topic: str | None = None) -> Recording:
    """Return a recording whose effort is what the robot's YAML says it is: `effort.topic` and `effort.field`.

    topic: of the joint states that hold the positions; None takes what the YAML or the bag says. Effort that comes by
    other messages is interpolated at the positions' stamps, linearly; samples without any beside them are left out.
    InputError in one line as of `read_recording`, and where a topic or field holds no effort of a joint.
    """
    path = Path(path)
    states = topic or robot.effort.topic
    if form_of(path) in TABLES:
        return read_recording(path, topic=states)
    sources = dict(robot.effort.sources)
    if topic is None and states is not None and not _has_positions(path, states):
        sources = {name: sources.get(name, EffortSource(states)) for name in robot.joints}
        states = None
    return _merged(path, states, sources, robot.joints) if sources else read_recording(path, topic=states)


def _has_positions(path: Path, topic: str) -> bool:
    """Return whether the first messages of a topic of joint states hold positions."""
    storage = open_storage(path)
    for batch in storage.batches([named_topic(storage, path, topic)]):
        return any(piece.position.shape[1] for piece in JointStateDecoder().decode(batch))
    return True


def _merged(path: Path, topic: str | None, sources: Mapping[str, EffortSource], joints: Sequence[str]) -> Recording:
    """Return positions of one topic with the efforts that stand elsewhere."""
    storage = open_storage(path)
    chosen = choose_topic(storage, path, topic)
    name = storage.topics[chosen].name
    told = {joint: replace(one, topic=one.topic or name) for joint, one in sources.items()}
    if any(one.field == "position" and one.topic.strip("/") == name.strip("/") for one in told.values() if one.topic):
        raise InputError(f"{path}: effort.field = position: topic {one_line(name)} holds the positions themselves")
    states = _pieces(storage, chosen)
    filled = [_room_for_effort(piece, told, whole=set(joints) <= set(told)) for piece in states]
    positions = assemble(filled, None, str(path), name, storage.notes, listing(storage))
    elsewhere = _Elsewhere(storage, path, _delay(states))
    tau, kept = positions.tau.copy(), np.ones(positions.samples, dtype=bool)
    used = {joint: one for joint, one in told.items() if joint in positions.names}
    for joint, place in used.items():
        tau[:, positions.names.index(joint)], there = elsewhere.series(joint, place).at(positions.t, positions.start_ns)
        kept &= there
    notes = [*positions.notes, *_said(used, name)]
    if not kept.any():
        raise InputError(f"{path}: no position of topic {one_line(name)} has an effort at its time; {listing(storage)}")
    if not kept.all():
        notes.append(f"{int((~kept).sum())} of {len(kept)} positions have no effort at their time and are left out")
    shares = any(
        one.field == "velocity" and one.topic.strip("/") == name.strip("/") for one in told.values() if one.topic
    )
    whole = replace(positions, tau=tau, dq=None if shares else positions.dq)[kept]
    return replace(whole, notes=tuple(notes), conditions=read_conditions(path))


def _pieces(storage: Storage, index: int) -> list[Piece]:
    decoder = JointStateDecoder()
    return [piece for batch in storage.batches([index]) for piece in decoder.decode(batch)]


def _room_for_effort(piece: Piece, elsewhere: Collection[str], *, whole: bool) -> Piece:
    """Return messages with zeros in place of efforts that stand elsewhere; whole: those of all joints do."""
    if whole:
        return replace(piece, effort=np.zeros_like(piece.position))
    if piece.effort.shape[1] != len(piece.names):
        return piece
    return replace(piece, effort=np.where([name in elsewhere for name in piece.names], 0.0, piece.effort))


def _delay(pieces: Sequence[Piece]) -> int:
    """Return the usual time [ns] from a header's stamp to the receipt of its message, 0 where there are no stamps."""
    late = [piece.log[piece.stamp != 0] - piece.stamp[piece.stamp != 0] for piece in pieces]
    both = np.concatenate(late) if late else np.zeros(0, dtype=np.int64)
    return int(both[0] + np.median(both - both[0])) if len(both) else 0


@dataclass(frozen=True)
class _Series:
    """The effort of one joint: stamps [k] ns, increasing, and values [k]."""

    stamp: Integers
    value: Array

    def at(self, t: Array, start: int) -> tuple[Array, np.ndarray]:
        """Return it at instants t [N] s since `start` ns, and whether there are efforts on both sides, or at it."""
        own = (self.stamp - start) / 1e9
        usual = np.median(np.diff(own)) if len(own) > 1 else 0.0
        right = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
        left = np.where(own[right] <= t, right, np.maximum(right - 1, 0))
        inside = (t >= own[0] - 0.5 * usual) & (t <= own[-1] + 0.5 * usual)
        return np.interp(t, own, self.value), inside & (own[right] - own[left] <= _GAP * usual)


class _Elsewhere:
    """The efforts that a bag holds on other topics, each of which is decoded once.

    delay: usual time [ns] from a joint state's stamp to its receipt, which stands in for the stamp that others lack.
    """

    def __init__(self, storage: Storage, path: Path, delay: int) -> None:
        self._storage, self._path, self._delay = storage, path, delay
        self._arrays: dict[str, list[tuple[Integers, Array]]] = {}
        self._states: dict[str, list[Piece]] = {}

    def series(self, joint: str, place: EffortSource) -> _Series:
        """Return the effort of a joint; InputError where there is none."""
        if place.topic is None:
            raise TypeError("a source of efforts has a topic")
        if place.index is None:
            parts = _of_joint(self._pieces(place.topic), joint, place.field, self._delay)
        else:
            tables = self._tables(place.topic)
            parts = [
                (log - self._delay, table[:, place.index]) for log, table in tables if table.shape[1] > place.index
            ]
        return _joined(parts, self._path, place, joint)

    def _tables(self, topic: str) -> list[tuple[Integers, Array]]:
        if topic not in self._arrays:
            index = named_topic(self._storage, self._path, topic, NUMBERS)
            self._arrays[topic] = [numbers_of(batch) for batch in self._storage.batches([index])]
        return self._arrays[topic]

    def _pieces(self, topic: str) -> list[Piece]:
        if topic not in self._states:
            self._states[topic] = _pieces(self._storage, named_topic(self._storage, self._path, topic))
        return self._states[topic]


def _said(used: Mapping[str, EffortSource], states: str) -> list[str]:
    """Return a line for each topic that efforts were taken from."""
    out = []
    for topic in dict.fromkeys(one.topic for one in used.values()):
        joints = {joint: one.field for joint, one in used.items() if one.topic == topic}
        fields = ", ".join(dict.fromkeys(joints.values()))
        out.append(one_line(f"effort of {', '.join(joints)} is {fields} of {topic}, at the stamps of {states}"))
    return out


def _of_joint(pieces: Sequence[Piece], joint: str, field: str, delay: int) -> list[tuple[Integers, Array]]:
    out = []
    for piece in pieces:
        values: Array = getattr(piece, field)
        if joint in piece.names and values.shape[1] == len(piece.names):
            stamp = np.where(piece.stamp == 0, piece.log - delay, piece.stamp)
            out.append((stamp, values[:, piece.names.index(joint)]))
    return out


def _joined(parts: Sequence[tuple[Integers, Array]], path: Path, place: EffortSource, joint: str) -> _Series:
    """Return the parts as one series in order of time, numbers only and each stamp once."""
    stamp = np.concatenate([part[0] for part in parts]) if parts else np.zeros(0, dtype=np.int64)
    value = np.concatenate([part[1] for part in parts]) if parts else np.zeros(0)
    there = np.isfinite(value)
    stamp, first = np.unique(stamp[there], return_index=True)
    if not len(stamp):
        raise InputError(
            f"{path}: topic {place.topic} holds no number for the effort of {joint} in field {place.field};"
            " the robot YAML's effort.topic and effort.field say where it stands"
        )
    return _Series(stamp, value[there][first])
