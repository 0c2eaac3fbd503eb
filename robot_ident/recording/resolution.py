"""How finely positions are resolved: the step of an encoder, seen in the recording."""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array

_LARGEST = 64  # steps: differences beyond as many say little about one of them
_OFF = 0.02  # of a step: how far a difference may lie from a whole number of steps
_LEAST = 30  # differences that are needed
_SHARE = 0.98  # of them that must be whole numbers of steps


def position_step(q: Array) -> Array:
    """Return the step [n] of positions q [N, n] of which all differences are multiples, 0 where there is none.

    The smallest difference between neighbours is taken for a step, and believed where nearly all other small
    differences are whole multiples of it.
    """
    return np.array([_step(np.abs(np.diff(column))) for column in np.asarray(q, dtype=float).T])


def _step(differences: Array) -> float:
    moved = differences[differences > 0]
    if len(moved) < _LEAST:
        return 0.0
    rounding = 8 * np.finfo(float).eps * max(1.0, float(moved.max()))
    moved = moved[moved > rounding]
    if len(moved) < _LEAST:
        return 0.0
    step = float(moved.min())
    near = moved[moved < _LARGEST * step] / step
    if len(near) < _LEAST or len(np.unique(np.round(near))) < 2:
        return 0.0
    whole = np.abs(near - np.round(near)) < _OFF * np.maximum(1.0, near / 8)
    return step if np.mean(whole) > _SHARE else 0.0
