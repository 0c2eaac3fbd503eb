"""Which of several topics with joint states is the robot's: the one that holds its joints."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from robot_ident.bags.forms import TABLES, form_of, open_storage
from robot_ident.bags.storage import one_line
from robot_ident.bags.topics import candidates, named_topic, peek


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
