"""The files that were saved since the workbench was started: they alone may be replaced."""

from __future__ import annotations

from pathlib import Path

Stamp = tuple[int, int, int, int]
"""Device, inode, size and date of a file: another one in its place has others."""


def stamp(path: Path) -> Stamp | None:
    """Return what tells a file from another one of its name; None where there is none."""
    try:
        found = path.lstat()
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


class Made:
    """Files as they were left when they were saved."""

    def __init__(self) -> None:
        self._left: dict[Path, Stamp | None] = {}

    def note(self, path: Path, left: Stamp | None) -> None:
        """Remember a file that was saved, and how it was left."""
        self._left[path] = left

    def still(self, path: Path) -> Stamp | None:
        """Return the stamp of a file that was saved here and is as it was left; None for any other."""
        left = self._left.get(path)
        return left if left is not None and stamp(path) == left else None
