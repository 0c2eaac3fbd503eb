"""Figures in words, alike in all sections."""

from __future__ import annotations

from collections.abc import Sequence

NOTHING = "–"


def short(value: float | None, digits: int = 3) -> str:
    """Return a number with so many digits, trailing zeros kept, a dash where there is none."""
    return NOTHING if value is None else f"{value:#.{digits}g}".rstrip(".") if value else "0"


def percent(share: float) -> str:
    """Return a share as a whole number of percent."""
    return f"{100.0 * share:.0f} %"


def joined(words: Sequence[str]) -> str:
    """Return `a`, `a and b` or `a, b and c`."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))) if words else ""
