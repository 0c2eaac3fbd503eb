"""Reads any form of recording into arrays, or message by message, its joints and efforts as a robot's YAML names them;
says what is in a bag without reading all of it.

A new form is one function here: a storage of messages in `FILES`, or a reader of tables in `TABLES`.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from robot_ident.bags.cdr import numbers_of
from robot_ident.bags.joint_states import JointStateDecoder, Piece, assemble, usual_delay
from robot_ident.bags.rosbag2 import FILES, Rosbag2Directory, open_file
from robot_ident.bags.storage import JOINT_STATE, NUMBERS, Integers, Storage, Topic, decompressed, one_line
from robot_ident.bags.tables import read_csv, read_npz, refuse_unnamed
from robot_ident.errors import InputError
from robot_ident.recording.checks import refuse_payload
from robot_ident.recording.conditions import read_conditions
from robot_ident.recording.effort import effort_at
from robot_ident.recording.recording import Recording
from robot_ident.recording.repairs import repaired
from robot_ident.robot import Robot
from robot_ident.robot.drives import EffortSource
from robot_ident.signals.motion import Array

TABLES: dict[str, Callable[[Path, Sequence[str] | None], Recording]] = {".csv": read_csv, ".npz": read_npz}
# the first bytes of a file whose suffix says nothing
_MAGIC = {b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\x00": ".db3", b"PK\x03\x04": ".npz"}
_ROS1 = b"#ROSBAG V"


def form_of(path: Path) -> str:
    """Return the suffix that says how to read `path`, "" for a rosbag2 folder; InputError when it is no recording."""
    if path.is_dir():
        return ""
    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if not path.is_file():
        raise InputError(f"{path}: is neither a file nor a folder")
    suffix = path.suffix.lower()
    if suffix in TABLES or suffix in FILES:
        return suffix
    if path.name.endswith(tuple(f"{known}.zstd" for known in FILES)):
        return ".zstd"
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from error
    if head.startswith(_ROS1):
        raise InputError(f"{path}: is a ROS 1 bag; convert it first (rosbags-convert --src {path} --dst FOLDER)")
    for magic, known in _MAGIC.items():
        if head.startswith(magic):
            return known
    raise InputError(
        f"{path}: is no recording; expected a rosbag2 folder, {', '.join(FILES)} or a table ({', '.join(TABLES)})"
    )


def open_storage(path: Path) -> Storage:
    """Open a bag of messages; InputError when `path` is a table or can't be read."""
    form = form_of(path)
    if form in TABLES:
        raise InputError(f"{path}: is a table, not a bag of messages")
    if not form:
        return Rosbag2Directory(path)
    return FILES[form](path) if form in FILES else open_file(path)


def read_recording(
    path: Path | str,
    *,
    topic: str | None = None,
    joints: Sequence[str] | None = None,
    velocities: bool = True,
) -> Recording:
    """Return the joint states of a recording in any form, sorted by stamp, t = 0 at the first sample.

    topic: of the JointState messages; None takes `joint_states` in whatever namespace, or the only one with efforts.
    joints: those wanted, in this order, matched by name; None takes all that the topic reports together. velocities:
    False leaves out those that messages report, which are a third of a long recording and which no model is fitted to.
    What was repaired or lost stands in `notes`, what the sidecar `BAG.conditions.yaml` states in `conditions`.
    InputError in one line: no such file, no bag, no such topic or joint, no samples, NaN.
    """
    path = Path(path)
    form = form_of(path)
    conditions = read_conditions(path)
    if form in TABLES:
        return replace(TABLES[form](path, joints), conditions=conditions)
    storage = open_storage(path)
    chosen = choose_topic(storage, path, topic)
    decoder = JointStateDecoder(velocities)
    pieces = [piece for batch in storage.batches([chosen]) for piece in decoder.decode(batch)]
    name = one_line(storage.topics[chosen].name)
    if not pieces:
        reason = f"; {decoder.unreadable} messages are no JointState: {decoder.reason}" if decoder.unreadable else ""
        raise InputError(f"{path}: topic {name} has no message that can be read{reason}{_because(storage)}")
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
            yield RawMessage(known[index], decompressed(batch.payload(number)), log_time, publish_time)


def read_for(path: Path | str, robot: Robot, *, topic: str | None = None) -> Recording:
    """Return a recording whose effort is what the robot's YAML says it is: `effort.topic` and `effort.field`; its
    positions are `repaired`.

    Velocities that messages of a bag report are left out: those of a model come from the positions.

    topic: of the joint states that hold the positions; None takes what the YAML or the bag says. Effort that comes by
    other messages is interpolated at the positions' stamps, linearly; samples without any beside them are left out.
    InputError in one line as of `read_recording`, and where a topic or field holds no effort of a joint.
    """
    path = Path(path)
    refuse_payload(read_conditions(path), robot, path)
    states = topic or robot.effort.topic
    if form_of(path) in TABLES:
        refuse_unnamed(path, robot.n)
        return repaired(read_recording(path, topic=states), robot)
    sources = dict(robot.effort.sources)
    if topic is None and states is not None and not _has_positions(path, states):
        sources = {name: sources.get(name, EffortSource(states)) for name in robot.joints}
        states = None
    if not sources:
        return repaired(read_recording(path, topic=states, velocities=False), robot)
    recording = with_efforts(open_storage(path), str(path), states, sources, robot.joints)
    return repaired(replace(recording, conditions=read_conditions(path)), robot)


def _has_positions(path: Path, topic: str) -> bool:
    """Return whether the first messages of a topic of joint states hold positions."""
    storage = open_storage(path)
    for batch in storage.batches([named_topic(storage, path, topic)]):
        return any(piece.position.shape[1] for piece in JointStateDecoder().decode(batch))
    return True


def topic_of_joints(path: Path | str, joints: Collection[str], topic: str | None = None) -> tuple[str | None, str]:
    """Return the topic whose joint states are those of a robot, and a line that says which were left aside.

    topic: asked for by name; its whole name is returned. Else, where several topics report efforts, the one that holds
    most of `joints`; None where there is no choice, or where two hold as many. Raises InputError as of
    `named_topic`. A table of columns has no topics: None.
    """
    path = Path(path)
    if form_of(path) in TABLES:
        return None, ""
    storage = open_storage(path)
    if topic is not None:
        return storage.topics[named_topic(storage, path, topic)].name, ""
    offered = candidates(storage)
    if len(offered) < 2:
        return None, ""
    held = {index: len(set(joints) & set(peek(storage, index)[0])) for index in offered}
    best = max(offered, key=lambda index: held[index])
    if held[best] == 0 or sum(count == held[best] for count in held.values()) > 1:
        return None, ""
    name = storage.topics[best].name
    others = one_line(*(f"{storage.topics[index].name} ({held[index]})" for index in offered if index != best))
    return name, f"{name} holds {held[best]} joints of the URDF, {others}: its states are taken (else --topic)"


@dataclass(frozen=True)
class TopicInfo:
    """One topic: messages, and for JointState the joints in the first messages and whether efforts are among them."""

    name: str
    type: str
    messages: int
    joints: tuple[str, ...] = ()
    efforts: bool = False


@dataclass(frozen=True)
class BagInfo:
    """What `info` shows of a bag; a table has one nameless topic of type `table`.

    form: in words. truncated: whether it breaks off. notes: one line for each thing lost, damaged or out of date.
    """

    path: str
    form: str
    topics: tuple[TopicInfo, ...]
    truncated: bool
    notes: tuple[str, ...]

    @property
    def messages(self) -> int:
        """Number of messages of all topics."""
        return sum(topic.messages for topic in self.topics)


def describe(path: Path | str) -> BagInfo:
    """Return topics, counts, joint names and damage of a recording in any form; InputError when it is none."""
    path = Path(path)
    form = form_of(path)
    if form in TABLES:
        recording = TABLES[form](path, None)
        table = TopicInfo("", "table", recording.samples, recording.names, True)
        return BagInfo(str(path), f"table ({form})", (table,), False, recording.notes)
    storage = open_storage(path)
    topics = []
    looked_at = set(joint_states(storage)[:MOST_PEEKED])
    for index, (topic, count) in enumerate(zip(storage.topics, storage.counts, strict=True)):
        joints, efforts = peek(storage, index) if index in looked_at else ((), False)
        topics.append(TopicInfo(topic.name, topic.type, count, joints, efforts))
    return BagInfo(str(path), storage.form, tuple(topics), storage.truncated, storage.notes)


_STRING = "std_msgs/msg/String"


def read_robot_description(path: Path | str, topic: str | None = None) -> str:
    """Return the URDF in a bag: the last message of `topic`, or of the one topic named robot_description.

    Raises InputError where there is none.
    """
    offers = [t.name for t in describe(path).topics if t.type == _STRING]
    found = [name for name in offers if name == topic or (topic is None and name.split("/")[-1] == "robot_description")]
    if not found:
        raise InputError(f"{path}: no topic {topic or 'robot_description'} of type {_STRING}; give the URDF as a file")
    if len(found) > 1:
        raise InputError(f"{path}: several topics carry a robot ({one_line(*found)}); name one")
    latest = deque(read_messages(path, found), maxlen=1)
    if not latest:
        raise InputError(f"{path}: topic {one_line(found[0])} holds no message; give the URDF as a file")
    return _text(latest[0].data, f"{path}: {one_line(found[0])}")


def _text(data: bytes, source: str) -> str:
    """Return the text of a std_msgs/String in CDR."""
    order = "<" if len(data) > 1 and data[1] & 1 else ">"
    if len(data) < 8:
        raise InputError(f"{source}: a message of {len(data)} bytes is no text")
    (size,) = struct.unpack_from(f"{order}I", data, 4)
    if size > len(data) - 8:
        raise InputError(f"{source}: a text of {size} bytes in a message of {len(data)}")
    try:
        return data[8 : 8 + size].rstrip(b"\0").decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{source}: not text ({error})") from error


STATES = "joint_states"
_PEEK = 64  # messages
MOST_PEEKED = 100  # topics; a bag with more is looked at by name
_FASTER = 1.5  # times the messages: a topic worth a word


def listing(storage: Storage) -> str:
    """Return the topics with type and number of messages, in one line for an error message."""
    entries = []
    for topic, count in zip(storage.topics, storage.counts, strict=True):
        encoding = "" if topic.encoding == "cdr" else f" [{topic.encoding}]"
        entries.append(one_line(f"{topic.name} {topic.type or 'of unknown type'}{encoding} ({count})"))
    return f"topics: {', '.join(entries)}" if entries else "it holds no topic at all"


def joint_states(storage: Storage) -> list[int]:
    """Return the indices of the topics that hold JointState messages in the encoding of ROS 2, at least one each."""
    return [index for index, count in enumerate(storage.counts) if count and _holds(storage.topics[index], JOINT_STATE)]


def _holds(topic: Topic, kind: str) -> bool:
    return topic.type == kind and topic.encoding == "cdr"


def peek(storage: Storage, index: int) -> tuple[tuple[str, ...], bool]:
    """Return the joints in a topic's first messages, and whether any of these messages reports efforts."""
    decoder = JointStateDecoder()
    names: dict[str, None] = {}
    efforts = False
    for batch in storage.batches([index]):
        for piece in decoder.decode(batch.pick(np.arange(min(len(batch), _PEEK)))):
            names.update(dict.fromkeys(piece.names))
            efforts = efforts or piece.effort.shape[1] > 0
        break
    return tuple(names), efforts


def choose_topic(storage: Storage, source: Path | str, topic: str | None) -> int:
    """Return the index of the topic that was asked for, or of the only one that can hold the robot's states.

    Without a name it is `joint_states` in whatever namespace; where several are called so, or none is, the one that
    reports efforts. Command topics are never taken for states. InputError lists what is there.
    """
    if topic is not None:
        return named_topic(storage, source, topic)
    with_efforts = candidates(storage)
    if len(with_efforts) == 1:
        return with_efforts[0]
    if len(with_efforts) > 1:
        names = one_line(*(storage.topics[index].name for index in with_efforts[:MOST_PEEKED]))
        raise InputError(f"{source}: several topics may hold the joint states ({names}); choose one with --topic")
    if not sum(storage.counts):
        raise InputError(f"{source}: the bag is empty{_because(storage)}; {listing(storage)}")
    raise InputError(f"{source}: has no {JOINT_STATE} with efforts{_because(storage)}; {listing(storage)}")


def candidates(storage: Storage) -> list[int]:
    """Return the indices of the topics that may hold the robot's states: the only one called `joint_states`, else those
    so called, or of any name where none is, that report efforts.
    """
    last = [known.name.rsplit("/", 1)[-1] for known in storage.topics]
    states = [index for index in joint_states(storage) if "command" not in last[index]]
    called = [index for index in states if last[index] == STATES]
    if len(called) == 1:
        return called
    offered = called or states
    return offered if len(offered) > MOST_PEEKED else [index for index in offered if peek(storage, index)[1]]


def faster(storage: Storage, chosen: int) -> tuple[str, ...]:
    """Return a line for every other topic that reports position and effort of the same joints more often."""
    topics, counts = storage.topics, storage.counts
    count = counts[chosen]
    more = [k for k in joint_states(storage) if k != chosen and counts[k] >= _FASTER * count]
    if not more or len(more) > MOST_PEEKED:
        return ()
    joints, out = set(peek(storage, chosen)[0]), []
    for index in more:
        names, efforts = peek(storage, index)
        name = one_line(topics[index].name)
        if efforts and joints and joints <= set(names) and "command" not in name.rsplit("/", 1)[-1]:
            out.append(f"{name} reports the same joints {counts[index] / count:.3g} times as often (--topic {name})")
    return tuple(out)


def named_topic(storage: Storage, source: Path | str, topic: str, kind: str = JOINT_STATE) -> int:
    """Return the index of a topic by its name, or its last words; InputError where none of this kind has messages."""
    wanted = topic.strip("/")
    named = [index for index, known in enumerate(storage.topics) if known.name.strip("/") == wanted]
    named = named or [index for index, known in enumerate(storage.topics) if known.name.endswith(f"/{wanted}")]
    usable = [index for index in named if _holds(storage.topics[index], kind)]
    if len(usable) > 1:
        names = one_line(*(storage.topics[index].name for index in usable))
        raise InputError(f"{source}: topic {topic!r} may be any of {names}; give the whole name")
    if not usable:
        what = f"is no {kind}" if named else "is not in it"
        raise InputError(f"{source}: topic {topic!r} {what}{_because(storage)}; {listing(storage)}")
    if not storage.counts[usable[0]]:
        raise InputError(f"{source}: topic {topic!r} has no messages{_because(storage)}; {listing(storage)}")
    return usable[0]


def _because(storage: Storage) -> str:
    return f" ({'; '.join(storage.notes)})" if storage.notes else ""


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
        tau[:, positions.names.index(joint)], there = effort_at(positions.t, positions.start_ns, *series)
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


def _joined(
    parts: Sequence[tuple[Integers, Array]], source: str, place: EffortSource, joint: str
) -> tuple[Integers, Array]:
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
    return stamp, value[there][first]
