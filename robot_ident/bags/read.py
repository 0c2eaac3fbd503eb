"""Reads any form of recording into arrays, or message by message."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robot_ident.bags import compression
from robot_ident.bags.assemble import assemble
from robot_ident.bags.forms import TABLES, form_of, open_storage
from robot_ident.bags.joint_state_decoder import JointStateDecoder
from robot_ident.bags.storage import Storage, Topic, one_line
from robot_ident.bags.topics import choose_topic, faster, listing
from robot_ident.errors import InputError
from robot_ident.recording.conditions import read_conditions
from robot_ident.recording.recording import Recording


def read_recording(
    path: Path | str,
    *,
    topic: str | None = None,
    joints: Sequence[str] | None = None,
    velocities: bool = True,
    vectorised: bool = True,
) -> Recording:
    """Return the joint states of a recording in any form, sorted by stamp, t = 0 at the first sample.

    topic: of the JointState messages; None takes `joint_states` in whatever namespace, or the only one with efforts.
    joints: those wanted, in this order, matched by name; None takes all that the topic reports together. velocities:
    False leaves out those that messages report, which are a third of a long recording and which no model is fitted to.
    vectorised: False reads every message singly, which gives the same and is slow. What was repaired or lost stands in
    `notes`, what the sidecar `BAG.conditions.yaml` states in `conditions`.
    InputError in one line: no such file, no bag, no such topic or joint, no samples, NaN.
    """
    path = Path(path)
    form = form_of(path)
    conditions = read_conditions(path)
    if form in TABLES:
        return replace(TABLES[form].read(path, joints), conditions=conditions)
    storage = open_storage(path)
    chosen = choose_topic(storage, path, topic)
    decoder = JointStateDecoder(vectorised, velocities)
    pieces = [piece for batch in storage.batches([chosen]) for piece in decoder.decode(batch)]
    name = one_line(storage.topics[chosen].name)
    if not pieces:
        reason = f"; {decoder.unreadable} messages are no JointState: {decoder.reason}" if decoder.unreadable else ""
        lost = f" ({'; '.join(storage.notes)})" if storage.notes else ""
        raise InputError(f"{path}: topic {name} has no message that can be read{reason}{lost}")
    losses = (*storage.notes, *faster(storage, chosen))
    if decoder.unreadable:
        losses += (f"{decoder.unreadable} messages of {name} are no JointState and left out ({decoder.reason})",)
    return replace(assemble(pieces, joints, str(path), name, losses, listing(storage)), conditions=conditions)


@dataclass(frozen=True)
class RawMessage:
    """One message as it was recorded: serialized bytes with its stamps in ns."""

    topic: Topic
    data: bytes
    log_time: int
    publish_time: int


def read_messages(path: Path | str, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
    """Yield the serialized messages of a bag in the order of its files, of the named topics or of all."""
    return raw_messages(open_storage(Path(path)), topics)


def raw_messages(storage: Storage, topics: Collection[str] | None = None) -> Iterator[RawMessage]:
    """Yield the serialized messages of an open storage, decompressed where each is compressed by itself."""
    known = storage.topics
    wanted = [index for index, topic in enumerate(known) if topics is None or topic.name in topics]
    for batch in storage.batches(wanted):
        places = (batch.topic.tolist(), batch.log_time.tolist(), batch.publish_time.tolist())
        for number, (index, log_time, publish_time) in enumerate(zip(*places, strict=True)):
            yield RawMessage(known[index], compression.message(batch.payload(number)), log_time, publish_time)
