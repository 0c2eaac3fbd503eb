"""A recording that something rests on: the file, as read, and as measured."""

from __future__ import annotations

from dataclasses import dataclass

from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording


@dataclass(frozen=True)
class Source:
    """A recording by its path and sha256, as read, and as it was processed for a model."""

    path: str
    sha256: str
    recording: Recording
    measured: Measurement
