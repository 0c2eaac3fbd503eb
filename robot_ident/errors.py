"""The errors that users see: one clear line each, turned into an exit code by the command line alone."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import accumulate

LONGEST = 2000  # characters of an error
_WORDS = 1000  # that are compared with a misspelt one
_LISTED = 300  # characters of a list of known words


def one_line(text: object, longest: int = LONGEST) -> str:
    """Return a text, parts of which may come from a damaged file, as one line that a terminal shows as it is."""
    words = " ".join("".join(c if c.isprintable() else " " for c in str(text)[: 4 * longest]).split())
    return words if len(words) <= longest else f"{words[: longest - 4]} ..."


class RobotIdentError(Exception):
    """Base of every error that robot_ident raises on purpose; its text is one line for the user."""

    exit_code = 2

    def __init__(self, text: object = "") -> None:
        """Make the text one line, whatever is quoted in it."""
        super().__init__(one_line(text))


class InputError(RobotIdentError):
    """A file, field, option or recording that can't be used; the text names it and its value."""


class CheckFailed(RobotIdentError):
    """A check that was asked for does not hold (exit code 3)."""

    exit_code = 3


def did_you_mean(value: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the nearest known word, or the list of what is known."""
    words = sorted(known)
    near = difflib.get_close_matches(value[:100], [word for word in words[:_WORDS] if len(word) <= 100], n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    lengths = accumulate(len(word) + 2 for word in words)
    listed = [word for word, length in zip(words, lengths, strict=False) if length <= _LISTED]
    more = f" and {len(words) - len(listed)} more" if len(words) > len(listed) else ""
    return f"; known: {one_line(', '.join(listed), _LISTED)}{more}" if words else ""
