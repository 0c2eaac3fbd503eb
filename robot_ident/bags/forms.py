"""The forms that a recording may have, and which one a path is.

A new form is one function here: a storage of messages in `FILES`, or a reader and a writer of tables in `TABLES`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from robot_ident.bags.rosbag2_directory import FILES, Rosbag2Directory, open_file
from robot_ident.bags.storage import Storage
from robot_ident.bags.tables import read_csv, read_npz, write_csv, write_npz
from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording


class Table(NamedTuple):
    """How a table is read and written."""

    read: Callable[[Path, Sequence[str] | None], Recording]
    write: Callable[[Path, Recording], None]


TABLES: dict[str, Table] = {".csv": Table(read_csv, write_csv), ".npz": Table(read_npz, write_npz)}
# the first bytes of a file whose suffix says nothing
_MAGIC = {b"\x89MCAP0\r\n": ".mcap", b"SQLite format 3\x00": ".db3", b"PK\x03\x04": ".npz"}
_ROS1 = b"#ROSBAG V"


def form_of(path: Path) -> str:
    """Return the suffix that says how to read `path`, "" for a rosbag2 folder; InputError when it is no recording."""
    if path.is_dir():
        return ""
    if not path.exists():
        raise InputError(f"{path}: there is no such file or folder")
    if not path.is_file():
        raise InputError(f"{path}: is neither a file nor a folder")
    suffix = path.suffix.lower()
    if suffix in TABLES or suffix in FILES:
        return suffix
    if path.name.endswith(tuple(f"{known}.zstd" for known in FILES)):
        return ".zstd"
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{path}: can't be read ({error.strerror})") from error
    if head.startswith(_ROS1):
        raise InputError(f"{path}: is a ROS 1 bag; convert it first (rosbags-convert --src {path} --dst FOLDER)")
    for magic, known in _MAGIC.items():
        if head.startswith(magic):
            return known
    raise InputError(
        f"{path}: is no recording; expected a rosbag2 folder, {', '.join(FILES)} or a table ({', '.join(TABLES)})"
    )


def open_storage(path: Path) -> Storage:
    """Open a bag of messages; InputError when `path` is a table or can't be read."""
    form = form_of(path)
    if form in TABLES:
        raise InputError(f"{path}: is a table, not a bag of messages")
    if not form:
        return Rosbag2Directory(path)
    return FILES[form](path) if form in FILES else open_file(path)
