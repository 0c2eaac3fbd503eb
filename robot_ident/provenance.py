"""Where a model comes from: recordings with their hashes, versions, options, date."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from robot_ident import __version__


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
