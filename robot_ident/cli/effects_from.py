"""`--effects-from FILE.py`: a user's own effects, for every verb that knows effects."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path


def add_effects_from(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    text = "Python file with user-defined effects (see examples/my_effects.py)"
    parser.add_argument("--effects-from", action="append", default=[], metavar="FILE.py", help=text)


def register_effects(files: Sequence[str]) -> None:
    """Add the effects of files to the catalogue of this process and of its workers; call it before one is made."""
    if not files:
        return
    from robot_ident.effects import load_effects, register
    from robot_ident.parallel import prepare

    for file in files:
        register(load_effects(file))
        path = Path(file).resolve()
        prepare(_register_source, str(path), path.read_bytes())


def _register_source(path: str, source: bytes) -> None:
    """Add the effects of a file's contents to the catalogue of a worker, which needn't have the file."""
    from robot_ident.effects import load_effects, register

    register(load_effects(path, source))
