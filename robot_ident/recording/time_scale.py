"""Does anything beside the stamps tell how fast they run? Inertia goes with the square of it."""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.recording.measurement import Measurement, TimeScale
from robot_ident.recording.recording import Recording

_SAME = 0.01  # by which the pace of two clocks may differ: 2 % of inertia


def time_scale(recording: Recording, base_frequency: float | None) -> TimeScale:
    """Return what tells: `period` where the motion's is declared, `received` where messages were received at the pace
    of their stamps, `apart` where they came at another pace; empty where nothing does.

    base_frequency [Hz]: as the user declares it. The recording was found to have it.
    """
    if base_frequency is not None:
        return "period"
    if recording.pace is None:
        return ""
    return "received" if abs(recording.pace - 1.0) < _SAME else "apart"


def time_scale_notes(measurements: Sequence[Measurement]) -> list[str]:
    """Return a line that names the recordings whose time scale nothing verifies, and one those whose messages came at
    another pace than their stamps.
    """
    untimed, apart = ([m.source for m in measurements if m.time_scale == kind] for kind in ("", "apart"))
    notes = []
    if untimed:
        notes.append(
            f"time scale not verified ({', '.join(untimed)}): only the stamps give it, and an error of 1 % changes"
            " inertias by 2 %; give --trajectory EXCITATION once per recording, or a bag with receive times"
        )
    if apart:
        notes.append(
            f"time scale contradicted ({', '.join(apart)}): messages came at another pace than their stamps; right for"
            " a simulated robot, on a real one the stamps' clock runs wrong, and inertia goes with the square of it"
        )
    return notes
