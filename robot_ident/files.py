"""Output files appear whole or not at all, an existing one is replaced only on request; texts are read to a bound.

What is neither a file nor a folder (a device, a pipe, a socket) is neither read nor replaced.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from robot_ident.errors import InputError

LARGEST_TEXT = 1 << 26
"""Bytes of a text (YAML, URDF, SRDF) that are read: 64 MiB, a hundred times the largest robot's."""

_SHOWN = 40  # characters of a file's name in that of the folder in which it is made


def is_special(path: Path | str) -> bool:
    """Tell a device, a pipe or a socket from a file, a folder, and what isn't there."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def refuse_special(path: Path | str) -> None:
    """Raise InputError where `path` is a device, a pipe or a socket: reading one may never end, and replacing one
    takes it from the machine.
    """
    if is_special(path):
        raise InputError(f"{path} is a device, a pipe or a socket; give the name of a file or a folder")


def read_bytes(path: Path | str, largest: int = LARGEST_TEXT) -> bytes:
    """Return what a file holds; InputError where it can't be read or holds more than `largest` bytes."""
    refuse_special(path)
    try:
        with open(path, "rb") as file:
            content = file.read(largest + 1)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror or error})") from error
    except ValueError as error:
        raise InputError(f"{str(path)!r} is no name of a file ({error})") from error
    if len(content) > largest:
        raise InputError(f"{path} has more than {largest >> 20} MiB; give a smaller file")
    return content


def read_text(path: Path | str, largest: int = LARGEST_TEXT) -> str:
    """Return the text of a file, its lines ended by newlines; InputError as `read_bytes`, and where it is no text."""
    try:
        return read_bytes(path, largest).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: can't be read as text ({error})") from error


def _refuse_as_output(path: Path) -> None:
    """Raise InputError where nothing can, or may, be written under a name, whatever --force says."""
    if path.name == "":
        raise InputError(f"{str(path)!r} is no name for an output; give the name of a file or a folder")
    refuse_special(path)
    folder = os.path.realpath(path.absolute().parent)
    if folder == "/dev" or folder.startswith("/proc/"):  # /dev/stdout, too, whatever it leads to
        raise InputError(f"{path} is among the machine's devices; give the name of a file or a folder elsewhere")
    try:
        os.lstat(path)
    except FileNotFoundError:
        pass
    except OSError as error:
        raise InputError(f"{path}: can't be written ({error.strerror})") from error


def refuse_existing(path: Path | str, *, force: bool) -> None:
    """Raise InputError when `path` exists and may not be replaced, or can't be written; call it before long work."""
    if not str(path):
        raise InputError("an output needs a name; it is empty")
    path = Path(path)
    _refuse_as_output(path)
    if path.exists() and not force:
        raise InputError(f"{path} exists already; give another name or --force to replace it")
    if path.is_dir() and not _is_ours(path):
        raise InputError(f"{path} is a folder that is no recording; --force does not replace it")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist")
    if not os.access(path.absolute().parent, os.W_OK):
        raise InputError(f"{path}: the folder {path.parent} can't be written to")


def _is_ours(folder: Path) -> bool:
    """Tell a recording (or an empty folder) from one that holds other things."""
    names = [entry.name for entry in folder.iterdir()]
    return not names or "metadata.yaml" in names or any(name.endswith((".mcap", ".db3")) for name in names)


@contextmanager
def whole(path: Path | str, *, force: bool = False) -> Iterator[Path]:
    """Yield a temporary path beside `path` (file or folder, to be made by the caller) and move it there on success."""
    path = Path(path)
    refuse_existing(path, force=force)
    try:
        room = Path(tempfile.mkdtemp(prefix=f".{path.name[:_SHOWN]}.", dir=path.absolute().parent))
    except OSError as error:
        raise InputError(f"{path}: can't be written ({error.strerror})") from error
    try:
        draft = room / path.name
        try:
            yield draft
        except OSError as error:
            raise InputError(f"{path}: can't be written ({error.strerror or error})") from error
        _put(draft, path, room / "replaced")
    finally:
        shutil.rmtree(room, ignore_errors=True)


def _put(draft: Path, path: Path, aside: Path) -> None:
    """Move a draft to its place; what is there, and can't be replaced in one step, comes back when that fails."""
    away = path.is_dir() or (draft.is_dir() and path.exists())
    try:
        if away:
            os.replace(path, aside)
        os.replace(draft, path)
    except OSError as error:
        if away and aside.exists():
            os.replace(aside, path)
        raise InputError(f"{path}: can't be written ({error.strerror or error})") from error


def write_text(path: Path | str, text: str, *, force: bool = False) -> None:
    """Write `text` to `path`, whole or not at all; InputError where a folder is in its place."""
    if Path(path).is_dir():
        raise InputError(f"{path} is a folder; the name of a file was expected")
    with whole(path, force=force) as draft:
        draft.write_text(text, encoding="utf-8")


def refuse_twice(paths: Iterable[Path | str]) -> None:
    """Raise InputError where a file or folder is named twice: what is counted twice looks better known than it is."""
    seen: set[str] = set()
    for path in paths:
        place = os.path.realpath(path)
        if place in seen:
            raise InputError(f"{path} is given twice; its noise would be counted as two independent recordings")
        seen.add(place)
