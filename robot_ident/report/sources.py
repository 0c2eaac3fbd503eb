"""Recordings and motions that a report rests on, read from disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from robot_ident.bags import read_for
from robot_ident.estimation.for_model import measured_for
from robot_ident.excitation.excitation import Excitation
from robot_ident.model.model import Model
from robot_ident.provenance import fingerprint
from robot_ident.recording.measurement import Source


def read_sources(
    bags: Sequence[str], model: Model, *, topic: str | None = None, heard: Callable[[str], None] = lambda what: None
) -> tuple[Source, ...]:
    """Return recordings as read and as measured for a model; InputError where one can't be used."""
    out = []
    for bag in bags:
        heard(f"reading {bag}")
        recording = read_for(bag, model.robot, topic=topic)
        out.append(Source(str(bag), fingerprint(bag), recording, measured_for(model, recording)))
    return tuple(out)


def read_excitations(named: Sequence[str], models: Sequence[Model]) -> list[tuple[str, Excitation]]:
    """Return the excitations that are named; where none is, those that the models say and that are still there."""
    paths = list(named)
    if not paths:
        noted = [model.provenance.get("options", {}).get("trajectory") or () for model in models]
        files = [file for one in noted for file in ([one] if isinstance(one, str) else one)]
        paths = list(dict.fromkeys(str(path) for path in files if Path(str(path)).is_file()))
    return [(path, Excitation.read(path)) for path in paths]
