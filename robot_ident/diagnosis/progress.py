"""How far a long computation has come, told to whoever waits for it."""

from __future__ import annotations

from collections.abc import Callable

Tell = Callable[[float, str], None]
"""Called with the part [0, 1] that is done, never falling, and what is being done."""

_STEP = 0.8  # of what is left: how many steps there will be is not known beforehand


def silent(done: float, what: str) -> None:
    """Tell nobody."""


def after(steps: int, begin: float, end: float) -> float:
    """Return where a part of the work stands after some steps of an unknown number of them."""
    return end - (end - begin) * _STEP**steps
