"""Figures in words, alike in all sections."""

from __future__ import annotations

import math
from collections.abc import Sequence

NOTHING = "–"
_SMALL, _LARGE = 4, 6  # powers of ten below and from which on they are written


def short(value: float | None, digits: int = 3) -> str:
    """Return a number with so many digits, trailing zeros kept, a dash where there is none.

    Powers of ten stand only where the number is very small or very large.
    """
    if value is None:
        return NOTHING
    if not value:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])  # of the rounded number
    if -_SMALL <= exponent < _LARGE:
        return f"{value:.{max(0, digits - 1 - exponent)}f}"
    return f"{value:.{digits - 1}e}"


def with_sigma(value: float, std: float) -> str:
    """Return `35.1 ± 3.0`: a value to the place of the second digit of its standard deviation; 0: it has none."""
    if not std or not math.isfinite(std):
        return f"{value:.4g}"
    exponent = int(f"{std:.1e}".partition("e")[2])
    if -_SMALL <= exponent < _LARGE:
        places = 1 - exponent
        value, std = round(value, places), round(std, places)
        return f"{value:.{max(0, places)}f} ± {std:.{max(0, places)}f}"
    return f"{value:.4g} ± {std:.1e}"


def percent(share: float) -> str:
    """Return a share as a whole number of percent."""
    return f"{100.0 * share:.0f} %"


def joined(words: Sequence[str]) -> str:
    """Return `a`, `a and b` or `a, b and c`."""
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1]))) if words else ""
