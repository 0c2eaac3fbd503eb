"""Makes a whole rosbag2 folder of a bag that breaks off, so that every other tool reads it again."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_ident.bags.forms import open_storage
from robot_ident.bags.read import RawMessage, raw_messages
from robot_ident.bags.storage import Storage
from robot_ident.bags.writer import BagWriter
from robot_ident.errors import InputError
from robot_ident.files import refuse_existing, whole


@dataclass(frozen=True)
class Recovery:
    """What `recover` did. kept: messages by topic. lost: one line for each loss, none for a bag that was whole."""

    source: str
    output: str
    kept: dict[str, int]
    lost: tuple[str, ...]

    @property
    def messages(self) -> int:
        """Number of messages kept."""
        return sum(self.kept.values())


def recover(path: Path | str, out: Path | str, *, force: bool = False) -> Recovery:
    """Copy every readable message of a bag, unchanged, into a whole rosbag2 folder with index and `metadata.yaml`.

    The messages come in the order of their receive times. The stamps, definitions, hashes and QoS stay. InputError when
    nothing can be read or `out` exists (and not `force`).
    """
    path, out = Path(path), Path(out)
    refuse_existing(out, force=force)
    if out.exists() and out.samefile(path):
        raise InputError(f"{out}: is the bag itself; give another name")
    storage = open_storage(path)
    impossible = 0
    kept: Counter[str] = Counter({topic.name: 0 for topic in storage.topics})
    with whole(out, force=force) as draft:
        with BagWriter(draft, storage.topics, shown_as=out) as bag:
            for message in in_time_order(storage):
                if message.topic.name not in kept:  # a channel that was declared anew has two names
                    bag.add_topic(message.topic)
                log_time, publish_time = max(message.log_time, 0), max(message.publish_time, 0)
                bag.write(message.topic.name, message.data, log_time, publish_time)
                kept[message.topic.name] += 1
                impossible += message.log_time < 0 or message.publish_time < 0
            bag.custom_data["recovered_from"] = path.name
        if not kept.total():
            raise InputError(f"{path}: no message can be read ({'; '.join(storage.notes) or 'the bag is empty'})")
    lost = storage.notes
    if impossible:
        lost += (f"{impossible} messages had a receive or send time after the year 2262; it is set to 0",)
    return Recovery(str(path), str(out), dict(kept), lost)


def in_time_order(storage: Storage) -> Iterator[RawMessage]:
    """Yield the messages of a storage by receive time, those of one time in the order of the file.

    No more are held at once than the file has out of place: a first pass finds how late a message comes at most.
    """
    newest, latest = np.iinfo(np.int64).min, 0
    for batch in storage.batches():
        before = np.maximum.accumulate(np.append(newest, batch.log_time))
        latest = max(latest, int((before[:-1] - batch.log_time)[before[:-1] > batch.log_time].max(initial=0)))
        newest = int(before[-1])
    held: list[tuple[int, int, RawMessage]] = []
    for number, message in enumerate(raw_messages(storage)):
        heapq.heappush(held, (message.log_time, number, message))
        while held and held[0][0] <= message.log_time - latest:
            yield heapq.heappop(held)[2]
    while held:
        yield heapq.heappop(held)[2]
