"""What an installed message package says of its types, for the schema of a bag's channels."""

from __future__ import annotations

import importlib.util
import json
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]\w*", re.MULTILINE)
_PRIMITIVES = frozenset(["bool", "byte", "char", "string", "wstring", "float32", "float64"]) | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_SEPARATOR = "=" * 80


def definition_of(kind: str) -> tuple[str, str]:
    """Return the text of a message type (`my_msgs/msg/Force`) with that of all it holds, and its RIHS01 hash.

    In the language `ros2msg`, as rosbag2 writes it into a bag; either is empty where the package doesn't say.
    """
    package, _, name = kind.partition("/msg/")
    text = _text(package, name)
    parts = [text] if text else []
    waiting, seen = list(_inner(text, package)), {(package, name)}
    while waiting:
        inner = waiting.pop(0)
        if inner in seen:
            continue
        seen.add(inner)
        content = _text(*inner)
        if not content:
            return "", _hash(package, name)  # half a definition can't be read by anyone
        parts.append(f"{_SEPARATOR}\nMSG: {inner[0]}/{inner[1]}\n{content}")
        waiting += _inner(content, inner[0])
    return "\n".join(parts), _hash(package, name)


def _inner(text: str, package: str) -> Iterator[tuple[str, str]]:
    """Yield package and name of the types that a definition's fields have."""
    for kind in _FIELD.findall("\n".join(line.partition("#")[0] for line in text.splitlines())):
        if kind not in _PRIMITIVES:
            *others, name = kind.split("/")
            yield others[0] if others else package, name


def _text(package: str, name: str) -> str:
    file = _file(package, f"{name}.msg")
    return file.read_text(encoding="utf-8", errors="replace") if file else ""


def _hash(package: str, name: str) -> str:
    file = _file(package, f"{name}.json")
    if file is None:
        return ""
    entries = json.loads(file.read_text(encoding="utf-8")).get("type_hashes", [])
    return next((str(e["hash_string"]) for e in entries if e.get("type_name") == f"{package}/msg/{name}"), "")


@cache
def _file(package: str, name: str) -> Path | None:
    """Return a file that a package installs beside its definitions: under a prefix of ROS, or of its Python module."""
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    module = importlib.util.find_spec(package)
    if module is not None and module.origin:
        prefixes += Path(module.origin).parents
    return next((file for prefix in prefixes if (file := prefix / "share" / package / "msg" / name).is_file()), None)
