"""How finely positions are resolved: the step of an encoder, seen in the recording."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.motion import Array

_LARGEST = 64  # steps: differences beyond as many say little about one of them
_OFF = 0.02  # of a step: how far a difference may lie from a whole number of steps
_LEAST = 30  # differences that are needed
_SHARE = 0.98  # of them that must be whole numbers of steps
_VALUES = 8  # that a coarse encoder must have shown, at least
_REPEATED = 4  # samples of each value, in the mean, from which on an encoder is coarse
_FAR = 3.0  # times the step that is declared, from which on a step is worth a word


def position_step(q: Array) -> Array:
    """Return the step [n] of positions q [N, n] of which all differences are multiples, 0 where there is none.

    The smallest difference between neighbours is taken for a step, and believed where nearly all other small
    differences are whole multiples of it; of a joint that is never slow, the smallest change of such a difference.
    Steps so coarse that no sample moves by two of them show in the values, of which there are few, at equal distances.
    """
    columns = np.asarray(q, dtype=float).T
    return np.array([_between_neighbours(x, 1) or _between_neighbours(x, 2) or _spacing(x) for x in columns])


def coarse_notes(steps: Array, declared: Array, joints: tuple[str, ...]) -> list[str]:
    """Return a line on the joints whose positions stand on far larger steps [n] than are declared [n] (0: none).

    Such steps repeat from period to period, where no scatter shows them, and velocity and acceleration have them too.
    """
    coarse = [
        f"{name} {step:.3g} ({step / told:.0f} times)"
        for name, step, told in zip(joints, steps, declared, strict=True)
        if step > _FAR * told > 0.0
    ]
    if not coarse:
        return []
    return [
        f"positions stand on steps far larger than encoder_step: {', '.join(coarse)}; something rounds them on the way;"
        " the rounding counts as their noise, and a finer topic or message tells more"
    ]


def _spacing(column: Array) -> float:
    """Return the distance of few values that stand at equal distances, or whole multiples of it."""
    values = np.unique(column)
    if len(values) * _REPEATED > len(column):
        return 0.0
    apart = np.diff(values)
    apart = apart[apart > _rounding(values)]
    if len(apart) < _VALUES:
        return 0.0
    step = float(np.median(apart))
    near = apart / step
    return step if np.mean(np.abs(near - np.round(near)) < _OFF) > _SHARE and np.all(near > 0.5) else 0.0


def _rounding(column: Array) -> float:
    return 8 * np.finfo(float).eps * max(1.0, float(np.abs(column).max(initial=0.0)))


def _between_neighbours(column: Array, order: int) -> float:
    """Return the step that differences between neighbours show (order 1), or changes of these (order 2)."""
    differences = np.abs(np.diff(column, n=order))
    moved = differences[differences > _rounding(column)]
    if len(moved) < _LEAST:
        return 0.0
    step = float(moved.min())
    near = moved[moved < _LARGEST * step] / step
    if len(near) < _LEAST or len(np.unique(np.round(near))) < 2:
        return 0.0
    whole = np.abs(near - np.round(near)) < _OFF * np.maximum(1.0, near / 8)
    return step if np.mean(whole) > _SHARE else 0.0
