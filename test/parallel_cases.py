"""What the tests of parallel work run in other processes, which import it by this name."""

from __future__ import annotations

import os
import time


def process_of(number: int) -> int:
    """Return the process that runs the case."""
    return os.getpid()


def slow_square(case: tuple[str, int]) -> int:
    """Leave a trace of the call in a folder, then take a while."""
    folder, number = case
    with open(os.path.join(folder, f"{number}_{os.getpid()}"), "w", encoding="utf-8"):
        time.sleep(0.5)
    return number * number


def known_where(effect: str) -> tuple[bool, int]:
    """Return whether this process has an effect in its catalogue, and which process it is."""
    from robot_ident.effects import CATALOGUE

    return effect in CATALOGUE, os.getpid()
