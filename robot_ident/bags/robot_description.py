"""The URDF that a bag carries: the text on `/robot_description`."""

from __future__ import annotations

import struct
from collections import deque
from pathlib import Path

from robot_ident.bags.describe import describe
from robot_ident.bags.read import read_messages
from robot_ident.bags.storage import one_line
from robot_ident.errors import InputError

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
