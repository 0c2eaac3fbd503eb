"""Output files appear whole or not at all; an existing one is replaced only on request."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from robot_ident.errors import InputError


def refuse_existing(path: Path | str, *, force: bool) -> None:
    """Raise InputError when `path` exists and may not be replaced; call it before long work."""
    path = Path(path)
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
        room = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.absolute().parent))
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
