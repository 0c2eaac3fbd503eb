"""Joints that are said to be held: where they stand in a recording, and the part of it in which they do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording

STILL = 0.01  # rad or m: a joint that strays less stands still
_LEAST = 0.3  # of a recording: where joints stand still for less, they aren't held


def held_angles(recording: Recording, held: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
    """Return the angle [rad, m] at which each joint stands most of the time, or the given one where it isn't recorded.

    Raises InputError where neither tells, or where they contradict each other.
    """
    out = {}
    for name in held:
        if name not in recording.names:
            if name not in given:
                raise InputError(
                    f"{recording.source}: {name} is to be held but is not in the recording;"
                    f" say where it stood: --hold {name}=ANGLE"
                )
            out[name] = float(given[name])
            continue
        angle = float(np.median(recording.q[:, recording.names.index(name)]))
        if name in given and abs(angle - given[name]) > STILL:
            raise InputError(f"{recording.source}: {name} stands at {angle:.4g}, not at {given[name]:.4g} (--hold)")
        out[name] = angle
    return out


def still_part(recording: Recording, angles: Mapping[str, float], instead: str = "name it in --joints") -> Recording:
    """Return the longest stretch of a recording in which every joint of `angles` stands there; what was left out is in
    its notes.

    Raises InputError where that is less than a third of it: those joints are not held. instead: what to do then.
    """
    there = [name for name in angles if name in recording.names]
    if not there:
        return recording
    away = {name: np.abs(recording.q[:, recording.names.index(name)] - angles[name]) > STILL for name in there}
    still = ~np.any(list(away.values()), axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    if not len(edges):
        first = last = 0
    else:
        best = int(np.argmax(edges[1::2] - edges[::2]))
        first, last = int(edges[2 * best]), int(edges[2 * best + 1])
    if last - first < _LEAST * recording.samples:
        worst = max(away, key=lambda name: int(away[name].sum()))
        reach = float(np.ptp(recording.q[:, recording.names.index(worst)]))
        raise InputError(
            f"{recording.source}: {worst} is to be held but moves by {reach:.3g}; {instead}, or cut the"
            " recording to where it stands still"
        )
    if last - first == recording.samples:
        return recording
    lost = recording.duration - float(recording.t[last - 1] - recording.t[first])
    part = recording[slice(first, last)]
    return replace(part, notes=(*part.notes, f"{lost:.3g} s left out in which {', '.join(there)} moved"))
