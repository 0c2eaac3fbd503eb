"""The errors that users see: one clear line each, turned into an exit code by the command line alone."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RobotIdentError(Exception):
    """Base of every error that robot_ident raises on purpose; its text is one line for the user."""

    exit_code = 2


class InputError(RobotIdentError):
    """A file, field, option or recording that can't be used; the text names it and its value."""


class CheckFailed(RobotIdentError):
    """A check that was asked for does not hold (exit code 3)."""

    exit_code = 3


def did_you_mean(value: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the nearest known word, or the list of what is known."""
    words = sorted(known)
    near = difflib.get_close_matches(value, words, n=1)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f"; known: {', '.join(words)}" if words else ""
