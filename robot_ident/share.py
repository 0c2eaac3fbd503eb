"""Finds the files that come with the package: robots and node parameters in `config/`."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from robot_ident.errors import InputError


def _places() -> Iterator[Path]:
    package = Path(__file__).resolve().parent
    if (package.parent / "package.xml").is_file():
        yield package.parent  # a checkout
    for parent in list(package.parents)[2:5]:  # PREFIX/lib/python3.x/site-packages/robot_ident
        yield parent / "share" / "robot_ident"
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / "robot_ident"


def share_folder() -> Path:
    """Return the folder that holds `config/`, in a checkout, a virtual environment or a ROS workspace alike."""
    for place in _places():
        if (place / "config").is_dir():
            return place
    raise InputError("the package's config folder was not found; install robot_ident again")


def config_file(*parts: str) -> Path:
    """Return the path of a file in `config/`."""
    return share_folder().joinpath("config", *parts)
