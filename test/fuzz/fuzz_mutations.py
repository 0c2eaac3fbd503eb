"""How a sound file becomes an unsound one: hypothesis strategies, so that what is found shrinks to its cause."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import yaml
from hypothesis import strategies as st

Draw = Callable[[st.SearchStrategy[Any]], Any]

LENGTHS = (0, 1, 7, 0x7F, 0xFFFF, 0x7FFF_FFFF, 0xFFFF_FFFF, 1 << 40, (1 << 63) - 1, 1 << 63, (1 << 64) - 1)
NUMBERS = (0, -0.0, -1, 1, 2, 3.5, 1e-300, 1e300, -1e300, 1.8e308, 5e-324, 2**31, 2**63, 10**40, 1e9, 1e17)
ODD: tuple[Any, ...] = (
    *NUMBERS,
    float("nan"),
    float("inf"),
    -float("inf"),
    10**3000,
    True,
    None,
    "",
    "x",
    "1e300",
    "joint_1",
    "a\nb\x00\x1b[31m",
    "\u202e\ud7ff\U0001f916",
    "x" * 5000,
    [],
    {},
    [[]],
    [0.0] * 3,
    [None],
    {"": {}},
    {"joint_1": {}},
    {1: 2},
)
TEXTS = (
    "nan",
    "inf",
    "-1",
    "0",
    "0 0 0",
    "1e300 0 0",
    "1e-200 0 0",
    "1 2",
    "",
    "x",
    "0x10",
    "1e999",
    "a" * 3000,
    "\u202e",
)


@st.composite
def bytes_of(draw: Draw, sound: bytes) -> bytes:
    """Flip, cut, repeat, overwrite with extreme lengths, insert: up to four of them in a row."""
    data = bytearray(sound)
    for _ in range(draw(st.integers(1, 4))):
        if not data:
            break
        # beginnings and ends, where lengths and indexes stand, as often as all else
        near = st.integers(0, min(200, len(data) - 1))
        at = draw(st.one_of(near, near.map(lambda k: len(data) - 1 - k), st.integers(0, len(data) - 1)))
        kind = draw(st.sampled_from(("flip", "cut", "length", "repeat", "insert", "remove", "zero")))
        size = draw(st.sampled_from((1, 2, 4, 8, 64, 1000)))
        if kind == "flip":
            data[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "cut":
            del data[at:]
        elif kind == "length":
            width = draw(st.sampled_from((1, 2, 4, 8)))
            order = draw(st.sampled_from(("little", "big")))
            value = draw(st.sampled_from(LENGTHS)) % (1 << 8 * width)
            data[at : at + width] = value.to_bytes(width, order)
        elif kind == "repeat":
            data[at:at] = data[at : at + size] * draw(st.sampled_from((1, 2, 50)))
        elif kind == "insert":
            data[at:at] = draw(st.binary(min_size=1, max_size=16))
        elif kind == "remove":
            del data[at : at + size]
        else:
            data[at : at + size] = bytes(len(data[at : at + size]))
    return bytes(data)


def records_of(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield place and size of the records of an MCAP file, as its specification says."""
    at = 8
    while at + 9 <= len(data) - 8:
        size = struct.unpack_from("<Q", data, at + 1)[0]
        yield at, size
        at += 9 + size


@st.composite
def mcap_of(draw: Draw, sound: bytes) -> bytes:
    """Change whole records of an MCAP file: its kind, its length, a number in it; repeat, move or drop it."""
    data = bytearray(sound)
    places = list(records_of(sound))
    for at, size in sorted(draw(st.lists(st.sampled_from(places), min_size=1, max_size=3, unique=True)), reverse=True):
        kind = draw(st.sampled_from(("opcode", "length", "field", "drop", "repeat", "swap")))
        if kind == "opcode":
            data[at] = draw(st.integers(0, 255))
        elif kind == "length":
            data[at + 1 : at + 9] = draw(st.sampled_from((*LENGTHS, size - 1, size + 1))).to_bytes(8, "little")
        elif kind == "field" and size:
            inner = at + 9 + draw(st.integers(0, min(size, 60) - 1))
            width = draw(st.sampled_from((1, 2, 4, 8)))
            data[inner : inner + width] = (draw(st.sampled_from(LENGTHS)) % (1 << 8 * width)).to_bytes(width, "little")
        elif kind == "drop":
            del data[at : at + 9 + size]
        elif kind == "repeat":
            data[at:at] = data[at : at + 9 + size] * draw(st.sampled_from((1, 3, 100)))
        else:
            other, length = draw(st.sampled_from(places))
            data[at : at + 9 + size] = sound[other : other + 9 + length]
    return bytes(data)


def _keys(data: Any) -> list[Any]:
    return list(data) if isinstance(data, dict) else list(range(len(data))) if isinstance(data, list) else []


@st.composite
def tree_of(draw: Draw, sound: Any) -> Any:
    """Put odd values into a tree of mappings and lists; drop, add and repeat entries."""
    data = copy.deepcopy(sound)
    for _ in range(draw(st.integers(1, 3))):
        parent = data
        if not (keys := _keys(parent)):
            break
        key = draw(st.sampled_from(keys))  # level by level, so that a large table doesn't draw all of it to itself
        while (keys := _keys(parent[key])) and draw(st.integers(0, 3)):
            parent, key = parent[key], draw(st.sampled_from(keys))
        kind = draw(st.sampled_from(("value", "value", "drop", "add", "nest")))
        if kind == "value":
            parent[key] = copy.deepcopy(draw(st.sampled_from(ODD)))
        elif kind == "drop":
            del parent[key]
        elif kind == "nest":
            parent[key] = [parent[key]]
        elif isinstance(parent, dict):
            parent[draw(st.sampled_from(("extra", "", 5, "schema")))] = copy.deepcopy(draw(st.sampled_from(ODD)))
        else:
            parent.insert(key, copy.deepcopy(parent[key]))
    return data


def yaml_of(sound: Any) -> st.SearchStrategy[bytes]:
    """Return YAML texts with odd values, and ones that are no YAML any more."""
    text = yaml.safe_dump(sound, sort_keys=False)
    trees = tree_of(sound).map(lambda data: yaml.safe_dump(data, sort_keys=False).encode())
    bombs = st.sampled_from((100, 10_000, 200_000)).flatmap(
        lambda depth: st.sampled_from(
            (
                "[" * depth,
                "a: " + "{a: " * depth,
                "- " * depth,
                "a: " + "[" * depth + "]" * depth,
                "a: &a [x, x]\n" + "".join(f"{k}: &-{k} [*-{k - 1}, *-{k - 1}]\n" for k in range(min(depth, 90))),
                text + "\nextra: " + "[" * depth + "]" * depth,
                text + f"\nextra: {'9' * depth}",
                text + "\nwhen: 2001-99-99",
                text + "\nwhat: !!python/object/apply:os.getcwd []",
                text + "\n? [a, b]\n: c",
                text + "\n<<: [1, 2]",
            )
        ).map(str.encode)
    )
    return st.one_of(trees, trees, bytes_of(text.encode()), bombs)


def json_of(sound: Any) -> st.SearchStrategy[bytes]:
    """Return JSON texts with odd values, and ones that are no JSON any more."""
    trees = tree_of(sound).map(lambda data: json.dumps(_plain(data)).encode())
    return st.one_of(trees, bytes_of(json.dumps(sound).encode()), st.sampled_from((b"[" * 100_000, b"1" * 5000, b"")))


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {str(key): _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, list) else data


@st.composite
def xml_of(draw: Draw, sound: str) -> bytes:
    """Put odd values into attributes; drop, repeat and rename elements."""
    root = ElementTree.fromstring(sound)
    for _ in range(draw(st.integers(1, 3))):
        parents = [element for element in root.iter() if len(element)]
        if not parents:
            break
        parent = draw(st.sampled_from(parents))
        element = draw(st.sampled_from(list(parent)))
        kind = draw(st.sampled_from(("value", "value", "value", "drop", "repeat", "rename", "missing")))
        if kind == "drop":
            parent.remove(element)
        elif kind == "repeat":
            parent.append(copy.deepcopy(element))
        elif kind == "rename":
            element.tag = draw(st.sampled_from(("x", "robot", "link", "joint", "mimic")))
        elif element.attrib:
            key = draw(st.sampled_from(sorted(element.attrib)))
            if kind == "value":
                others = tuple(other.get(key, "") for other in root.iter(element.tag))
                element.set(key, draw(st.sampled_from((*TEXTS, *others))))
            else:
                del element.attrib[key]
    return ElementTree.tostring(root)


ENTITY_BOMB = (
    '<!DOCTYPE r [<!ENTITY a0 "xxxxxxxxxx">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
    + ']><robot name="&a11;"><link name="a"/></robot>'
).encode()


def urdf_of(sound: str) -> st.SearchStrategy[bytes]:
    """Return URDFs with odd values, and ones that are no XML any more."""
    deep = b"<robot name='a'>" + b"<link name='b'>" * 100_000
    return st.one_of(xml_of(sound), xml_of(sound), bytes_of(sound.encode()), st.sampled_from((ENTITY_BOMB, deep, b"")))


@st.composite
def csv_of(draw: Draw, sound: str) -> bytes:
    """Put odd words into cells, rows and the header."""
    rows = [line.split(",") for line in sound.splitlines()]
    words = (
        *map(str, NUMBERS),
        "nan",
        "inf",
        "",
        "x",
        "1e999",
        "0x1",
        '"',
        '"a\nb"',
        "\0",
        "#",
        "q_joint_1",
        "9" * 5000,
    )
    for _ in range(draw(st.integers(1, 4))):
        row = rows[draw(st.one_of(st.integers(0, 3), st.integers(0, len(rows) - 1))) % len(rows)]
        kind = draw(st.sampled_from(("cell", "cell", "drop", "add", "column", "constant")))
        place = draw(st.integers(0, max(len(row) - 1, 0)))
        word = draw(st.sampled_from(words))
        if kind == "cell" and row:
            row[place] = word
        elif kind == "drop" and row:
            del row[place]
        elif kind == "add":
            row.extend([word] * draw(st.sampled_from((1, 5, 20_000))))
        else:
            for other in rows[1:]:
                if place < len(other):
                    other[place] = word if kind == "constant" else other[0]
    return "\n".join(map(",".join, rows)).encode() + draw(st.sampled_from((b"", b"\n")))
