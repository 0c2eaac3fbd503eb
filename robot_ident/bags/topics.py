"""Which topic of a bag holds the joint states."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_ident.bags.joint_states import JointStateDecoder
from robot_ident.bags.storage import JOINT_STATE, Storage, Topic, one_line
from robot_ident.errors import InputError

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
