"""The file of finished cases, a line each, written as soon as it is finished: a trial that was stopped goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

from pydantic import ValidationError

from robot_ident.errors import InputError, one_line
from robot_ident.testbed.trial import Case


class Outcome(Protocol):
    """What a case gave, as the file keeps it."""

    @property
    def seed(self) -> int:
        """The seed of its case."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as data."""


Kept = TypeVar("Kept", bound=Outcome)
SCHEMA = "robot_ident/trial_cases/3"


class Journal(Generic[Kept]):
    """Finished cases, on disk a line each below a header that says which trial they are of."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.outcomes: dict[Case, Kept] = {}

    @classmethod
    def open(
        cls, path: str | None, settings: dict[str, Any], of_dict: Callable[[Mapping[str, Any]], Kept]
    ) -> Journal[Kept]:
        """Return what is finished, each outcome by `of_dict`; InputError where the file belongs to another trial, or is
        none of cases.

        A line without its end was torn off when it was written. A file is only written to once it is known to be one of
        cases, or empty.
        """
        journal = cls(Path(path) if path else None)
        if journal.path is None:
            return journal
        try:
            text = journal.path.read_text(encoding="utf-8") if journal.path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: can't be used as a file of cases ({error})") from error
        header, *lines = text.split("\n")
        whole = bool(lines)
        if whole:
            _same(_parsed(header, path, 1), settings, path)
        elif not json.dumps(settings).startswith(header):
            raise InputError(f"{path}: is no file of cases ({SCHEMA!r})")
        for number, line in enumerate(lines[:-1], 2):
            case, outcome = _case(_parsed(line, path, number), of_dict, path, number)
            journal.outcomes[case] = outcome
        if not whole:
            journal._write("w", json.dumps(settings) + "\n")
        elif lines[-1]:
            journal._write("w", "\n".join([header, *lines[:-1], ""]))
        return journal

    def add(self, case: Case, outcome: Kept) -> None:
        """Keep an outcome; InputError where it can't be written."""
        self.outcomes[case] = outcome
        self._write("a", json.dumps({**outcome.to_dict(), "asked": case.kind}) + "\n")

    def _write(self, mode: str, text: str) -> None:
        if self.path is None:
            return
        try:
            with self.path.open(mode, encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise InputError(f"{self.path}: can't be written ({error.strerror or error})") from error


def _parsed(line: str, path: str | None, number: int) -> Any:
    try:
        return json.loads(line)
    except json.JSONDecodeError as error:
        what = "is no file of cases" if number == 1 else f"line {number} is no case"
        raise InputError(f"{path}: {what} ({error})") from error


def _case(data: Any, of_dict: Callable[[Mapping[str, Any]], Kept], path: str | None, number: int) -> tuple[Case, Kept]:
    """Return a case and its outcome; InputError on a line that holds another thing."""
    try:
        asked = data.pop("asked")
        outcome = of_dict(data)
        return Case(outcome.seed, asked), outcome
    except (AttributeError, KeyError, TypeError) as error:
        raise InputError(f"{path}: line {number} is no case ({type(error).__name__}: {error})") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: line {number} is no case ({one_line(where)}: {first['msg']})") from error


def _same(found: Any, settings: dict[str, Any], path: str | None) -> None:
    if not isinstance(found, dict) or found.get("schema") != SCHEMA:
        raise InputError(f"{path}: is no file of cases ({SCHEMA!r})")
    for key, value in settings.items():
        if found.get(key) != value:
            raise InputError(f"{path}: holds cases of {key} {found.get(key)!r}, not {value!r}; give another file")
