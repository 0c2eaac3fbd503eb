"""Answers that nobody reads by accident: what was hidden in a simulated robot."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

from robot_ident.errors import InputError
from robot_ident.files import read_text

SCHEMA = "robot_ident/sealed/1"
NOTE = "what was hidden in the simulated robot; to open it: robot_ident trial --open FILE"

_LARGEST = 1 << 20  # bytes of an answer; what is packed may claim to be any size


def sealed_path(bag: Path | str) -> Path:
    """Return where the answer to a bag lies: beside it, `BAG.sealed`."""
    bag = Path(bag)
    return bag.with_name(bag.name + ".sealed")


def seal(answer: dict[str, Any]) -> str:
    """Return the text of a sealed file."""
    packed = base64.b64encode(zlib.compress(json.dumps(answer, sort_keys=True).encode())).decode()
    return json.dumps({"schema": SCHEMA, "note": NOTE, "sealed": packed}, indent=2) + "\n"


def open_sealed(path: Path | str) -> dict[str, Any]:
    """Return the answer of a sealed file, or of a bag beside which one lies; InputError where it can't be read."""
    path = sealed_path(path) if sealed_path(path).is_file() else Path(path)
    try:
        data = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: can't be read as a sealed file ({error})") from error
    schema = data.get("schema") if isinstance(data, dict) else None
    if schema != SCHEMA:
        raise InputError(f"{path}: schema: {schema!r} is no sealed file ({SCHEMA!r})")
    try:
        packed = base64.b64decode(data["sealed"], validate=True)
        answer = json.loads(zlib.decompressobj().decompress(packed, _LARGEST))
    except (KeyError, TypeError, ValueError, RecursionError, zlib.error) as error:
        raise InputError(f"{path}: sealed: damaged ({error})") from error
    if not isinstance(answer, dict):
        raise InputError(f"{path}: sealed: holds no answer")
    return answer
