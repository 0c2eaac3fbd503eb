"""Where a model comes from: recordings with their hashes, versions, options, date; and where the robots and node
parameters are that are installed with the package.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from robot_ident import __version__
from robot_ident.errors import InputError


def fingerprint(path: Path | str) -> str:
    """Return the sha256 of a file, or of all files of a folder with their names."""
    path = Path(path)
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
        if file.is_file():
            digest.update(b"" if file == path else file.relative_to(path).as_posix().encode())
            with file.open("rb") as stream:
                for block in iter(lambda: stream.read(1 << 20), b""):
                    digest.update(block)
    return digest.hexdigest()


def was_fitted(bag: str, known: Mapping[str, Any]) -> bool:
    """Return whether a recording is, byte for byte, one of those from which a model comes."""
    hashes = {one.get("sha256") for one in known.get("recordings", ())}
    return bool(hashes) and fingerprint(bag) in hashes


def provenance(bags: Sequence[str], options: dict[str, Any]) -> dict[str, Any]:
    """Return the provenance of a model made from some bags."""
    import numpy

    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "robot_ident": __version__,
        "numpy": numpy.__version__,
        "recordings": [{"path": str(bag), "sha256": fingerprint(bag)} for bag in bags],
        "options": {key: value for key, value in options.items() if value is not None},
    }


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
