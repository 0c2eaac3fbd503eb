"""Does anything beside the stamps tell how fast they run? Inertia goes with the square of it."""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording

_SAME = 0.01  # by which the pace of two clocks may differ: 2 % of inertia


def time_scale(recording: Recording, base_frequency: float | None) -> str:
    """Return what tells: `period` where the motion's is declared, `received` where messages were received at the pace
    of their stamps; empty where nothing does.

    base_frequency [Hz]: as the user declares it. The recording was found to have it.
    """
    if base_frequency is not None:
        return "period"
    return "received" if recording.pace is not None and abs(recording.pace - 1.0) < _SAME else ""


def pace_notes(recording: Recording) -> list[str]:
    """Return a line where messages came at another pace than their stamps."""
    if recording.pace is None or abs(recording.pace - 1.0) < _SAME:
        return []
    return [
        f"messages came in {recording.pace:.4g} times the time that their stamps span: right for a simulated robot;"
        " on a real one the stamps' clock runs wrong, and inertia goes with the square of it"
    ]


def scale_note(measurements: Sequence[Measurement]) -> list[str]:
    """Return a line that names the recordings whose time scale nothing verifies."""
    unverified = [measured.source for measured in measurements if not measured.time_scale]
    if not unverified:
        return []
    return [
        f"time scale not verified ({', '.join(unverified)}): nothing beside the stamps tells how fast they run, and"
        " inertia goes with the square of it; --trajectory EXCITATION tells, or a bag with the times at which messages"
        " came"
    ]
