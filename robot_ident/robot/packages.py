"""Where files named by a URDF or a robot YAML are: beside it, in a ROS workspace or in a Python package."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlparse


def find_resource(name: str, folder: Path) -> Path | None:
    """Return the file that `package://PACKAGE/...`, `file://...` or a path relative to `folder` means, or None."""
    kind, _, rest = name.partition("://")
    if not rest:
        path = folder / name
        return path if path.is_file() else None
    if kind == "file":
        path = Path(unquote(urlparse(name).path))
        return path if path.is_file() else None
    return next((path for place in _places(folder) if (path := place / rest).is_file()), None)


def _places(folder: Path) -> Iterator[Path]:
    """Yield the folders in which packages are looked for, the nearest first."""
    folder = folder.resolve()
    yield from (folder, *folder.parents)
    for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if path:
            yield from (Path(path), Path(path).parent)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share"
    for base in map(Path, sys.path):
        yield base / "cmeel.prefix" / "share"  # where the wheels of the Pinocchio project put their robots
    yield Path(sys.prefix) / "share"
