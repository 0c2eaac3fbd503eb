"""Which files a browser may name, those below the folder of the start and those named on the command line, and where
it may write: under new names, and over what was saved since the workbench was started.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

from robot_ident.errors import InputError

_DEEP = 3  # levels of folders that are searched
_MOST = 200  # recordings or models listed
_HEAD = 2000  # bytes of a YAML file in which it says what it is

RECORDINGS = (".mcap", ".db3", ".npz", ".csv")
"""Endings of the files that hold recordings."""

BUILT_IN = ("kuka_ir361", "kuka_ir361_spring")
"""Robots that need no file."""


class Allowed:
    """The folder `root` with all below it, and single paths named on the command line, links followed."""

    def __init__(self, root: Path, named: Sequence[str] = ()) -> None:
        self.root = root.resolve()
        self._named = {Path(self.root, name).resolve() for name in named}

    def checked(self, name: str) -> Path:
        """Return the path that a browser named, links followed; InputError where it lies elsewhere."""
        if not name or "\0" in name:
            raise InputError(f"{name!r} is no path")
        path = Path(self.root, name).resolve()
        if path in self._named or path == self.root or self.root in path.parents:
            return path
        raise InputError(
            f"{name}: outside of {self.root}; start the workbench in another folder, or name the file when you start it"
        )

    def below(self, name: str) -> Path:
        """Return a path strictly below the root, links followed; InputError where it lies elsewhere, named or not."""
        path = self.checked(name)
        if path in self._named:
            raise InputError(f"{name}: was named when the workbench was started, and is only read; give another name")
        if self.root not in path.parents:
            raise InputError(f"{name}: is no file below {self.root}; name one")
        return path

    @property
    def outside(self) -> list[Path]:
        """The named paths that do not lie below the root."""
        return sorted(path for path in self._named if self.root not in path.parents)

    def shown(self, path: Path | str) -> str:
        """Return a path as users know it: relative to the root where it lies below."""
        path = Path(self.root, path)
        return str(path.relative_to(self.root)) if path.is_relative_to(self.root) else str(path)


def below(root: Path, wanted: Callable[[Path], bool]) -> list[str]:
    """Return what is wanted of all below a folder, relative to it, what is in one folder together."""
    return [str(path.relative_to(root)) for path in islice(filter(wanted, _walk(root, 0)), _MOST)]


def describes_robot(path: Path) -> bool:
    """Return whether a file is a URDF, or a YAML file that says in one of its first lines that it describes a robot."""
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return path.suffix == ".urdf"
    with path.open("rb") as file:
        return b"schema: robot_ident/robot/" in file.read(_HEAD)


def _walk(folder: Path, depth: int) -> Iterator[Path]:
    """Yield files and recordings' folders; a recording's folder and a session's are not entered."""
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    for entry in entries:
        if entry.name.startswith(".") or entry.is_symlink():
            continue
        path = Path(entry.path)
        yield path
        if entry.is_dir() and depth < _DEEP and not is_recording(path) and not (path / "session.yaml").is_file():
            yield from _walk(path, depth + 1)


def is_recording(path: Path) -> bool:
    """Return whether a folder or a file holds a recording, by its name and its files' names."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or any(path.glob("*.mcap")) or any(path.glob("*.db3"))
    return path.suffix.lower() in RECORDINGS


Stamp = tuple[int, int, int, int]
"""Device, inode, size and date of a file: another one in its place has others."""


def stamp(path: Path) -> Stamp | None:
    """Return what tells a file from another one of its name; None where there is none."""
    try:
        found = path.lstat()
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns
