"""What is in a bag, without reading all of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robot_ident.bags.forms import TABLES, form_of, open_storage
from robot_ident.bags.topics import MOST_PEEKED, joint_states, peek


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
        recording = TABLES[form].read(path, None)
        table = TopicInfo("", "table", recording.samples, recording.names, True)
        return BagInfo(str(path), f"table ({form})", (table,), False, recording.notes)
    storage = open_storage(path)
    topics = []
    looked_at = set(joint_states(storage)[:MOST_PEEKED])
    for index, (topic, count) in enumerate(zip(storage.topics, storage.counts, strict=True)):
        joints, efforts = peek(storage, index) if index in looked_at else ((), False)
        topics.append(TopicInfo(topic.name, topic.type, count, joints, efforts))
    return BagInfo(str(path), storage.form, tuple(topics), storage.truncated, storage.notes)
