"""Output files appear whole or not at all; an existing one is replaced only on request."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
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
        if path.is_dir():
            os.replace(path, room / "replaced")
        os.replace(draft, path)
    finally:
        shutil.rmtree(room, ignore_errors=True)


def write_text(path: Path | str, text: str, *, force: bool = False) -> None:
    """Write `text` to `path`, whole or not at all."""
    with whole(path, force=force) as draft:
        draft.write_text(text, encoding="utf-8")
