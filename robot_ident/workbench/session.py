"""A session on disk: recordings, and a tree of steps, each a model with what was added to the one before.

Everything is written when it is made, whole or not at all: `session.yaml` (what was opened), `here.yaml` (the step that
is looked at), and a folder for every step. A program that is killed loses nothing but what it was computing.

The command lines that give the same models.
"""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pydantic import Field

from robot_ident.configuration import Closed, read, schema, to_yaml
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.report.wording import joined

_PREFIX = "step_"
_SCHEMA = "robot_ident/workbench/1"


class Choice(Closed):
    """`session.yaml`: what was opened, as it was named; folder: what names are relative to.

    stamps: size and date of each file: where a recording of the same name was made anew, it is another session.
    """

    schema_: schema(_SCHEMA) = Field(_SCHEMA, alias="schema")  # type: ignore[valid-type]
    folder: str
    recordings: list[str]
    validation: list[str] = []
    model: str | None = None
    robot: str | None = None
    topic: str | None = None
    effects_from: list[str] = []
    stamps: list[str] = []
    started: str = ""

    @property
    def in_words(self) -> str:
        """The recordings, those of validation apart."""
        unseen = f"; validation {', '.join(self.validation)}" if self.validation else ""
        return f"{', '.join(self.recordings)}{unseen}"


class Here(Closed):
    """`here.yaml`: the step that is looked at, and the way forward from each step that was left by undo."""

    step: int = Field(0, ge=0)
    forward: dict[str, int] = {}


class StepFile(Closed):
    """`step.yaml`: the number of the step before, and the effect that was added to its model; None where the model was
    brought or identified.
    """

    parent: int | None = None
    added: str | None = None
    made: str


@dataclass(frozen=True)
class Session:
    """A folder with a session's files."""

    folder: Path
    choice: Choice

    @classmethod
    def open(cls, folder: Path) -> Session:
        """Open a session that was begun earlier."""
        return cls(folder, read(Choice, folder / "session.yaml"))

    def own_effects(self, named: Sequence[str]) -> list[Path]:
        """Return the Python files of effects that the session needs, links followed.

        Raises InputError where one is not among those named on the command line: a session may come from anybody, and
        these files are run.
        """
        files = [Path(self.choice.folder, path).resolve() for path in self.choice.effects_from]
        known = {Path(path).resolve() for path in named}
        if strange := [str(path) for path in files if path not in known]:
            options = [word for path in map(str, files) for word in ("--effects-from", path)]
            command = shlex.join(["robot_ident", "workbench", *options, "--folder", str(self.folder.parent)])
            raise InputError(
                f"{self.name} needs the effects of {joined(strange)}, which the command line did not name, so that"
                f" nothing of them was run; read them, and if you trust them, start again by: {command}"
            )
        return files

    def refuse_links(self) -> None:
        """Raise InputError where a step is kept behind a link, which would lead what is written elsewhere."""
        for path in (self.folder, *self.folder.iterdir()):
            if path.is_symlink():
                raise InputError(
                    f"{self.name} holds the link {path.name}, behind which nothing is written; put what it leads to in"
                    " its place"
                )

    def sweep(self) -> None:
        """Remove what was being written when a program broke off; only while nothing computes for the session."""
        for draft in self.folder.glob(".*.*"):
            shutil.rmtree(draft, ignore_errors=True)

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.folder.name

    @property
    def steps(self) -> dict[int, StepFile]:
        """All steps that are complete, by number."""
        numbers = sorted(int(path.name.removeprefix(_PREFIX)) for path in self.folder.glob(f"{_PREFIX}[0-9]*"))
        return {number: read(StepFile, self.step_folder(number) / "step.yaml") for number in numbers}

    @property
    def here(self) -> int:
        """The number of the step that is looked at."""
        return self._here().step

    def step_folder(self, number: int) -> Path:
        """Return the folder of a step."""
        return self.folder / f"{_PREFIX}{number}"

    def model_file(self, number: int) -> Path:
        """Return the model of a step."""
        return self.step_folder(number) / "model.yaml"

    def next_number(self) -> int:
        """Return a number that no step has."""
        return max(self.steps, default=-1) + 1

    def go(self, number: int) -> None:
        """Look at a step; InputError where there is none of that number."""
        steps = self.steps
        if number not in steps:
            raise InputError(f"there is no step {number}")
        forward = self._here().forward
        for below, above in zip(self.path(number), self.path(number)[1:], strict=False):
            forward = {**forward, str(below): above}
        self._write(Here(step=number, forward=forward))

    def undo(self) -> None:
        """Look at the step before; the one that is left stays on disk."""
        parent = self.steps[self.here].parent
        if parent is None:
            raise InputError("this is the first step; there is nothing to undo")
        self._write(Here(step=parent, forward={**self._here().forward, str(parent): self.here}))

    def redo(self) -> None:
        """Look at the step that was left by the last undo."""
        if not self.can_redo:
            raise InputError("nothing was undone here")
        self.go(self._here().forward[str(self.here)])

    @property
    def can_redo(self) -> bool:
        """Whether a step was left by undo."""
        return self._here().forward.get(str(self.here)) in self.steps

    def path(self, number: int) -> list[int]:
        """Return the steps from the first one to a step."""
        steps, out = self.steps, [number]
        while (parent := steps[out[-1]].parent) is not None:
            out.append(parent)
        return out[::-1]

    def added(self, number: int) -> list[str]:
        """Return what was added on the way from the first step to a step."""
        steps = self.steps
        return [label for label in (steps[k].added for k in self.path(number)) if label]

    def find(self, parent: int, label: str) -> int | None:
        """Return the step that adds an effect to another step, None where there is none."""
        return next((k for k, step in self.steps.items() if step.parent == parent and step.added == label), None)

    def preview_file(self, number: int, label: str, suffix: str) -> Path:
        """Return the file of what a step's model would become with an effect."""
        return self.step_folder(number) / f"preview_{quote(label, safe='@')}{suffix}"

    def previews(self, number: int) -> dict[str, dict[str, Any]]:
        """Return what is known of the effects that were looked at from a step, by label."""
        files = sorted(self.step_folder(number).glob("preview_*.json"))
        return {str(data["label"]): data for data in map(read_json, files) if data is not None}

    def _here(self) -> Here:
        path = self.folder / "here.yaml"
        return read(Here, path) if path.is_file() else Here()

    def _write(self, here: Here) -> None:
        write_text(self.folder / "here.yaml", to_yaml(here.model_dump()), force=True)


def read_json(path: Path) -> dict[str, Any] | None:
    """Return a JSON file, None where there is none."""
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None


def now() -> str:
    """Return the time in words that sort."""
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


def sessions_in(folder: Path) -> tuple[list[Session], list[str]]:
    """Return the sessions of a folder, the newest first, and what is wrong with those that can't be opened."""
    found: list[Session] = []
    refused: list[str] = []
    for path in sorted(folder.glob("*/session.yaml")):
        try:
            found.append(Session.open(path.parent))
        except InputError as error:
            refused.append(str(error))
    return sorted(found, key=lambda session: (session.choice.started, session.name), reverse=True), refused


def begin(folder: Path, choice: Choice) -> Session:
    """Return the session on the same recordings and model that was begun before, or a new one; InputError where
    nothing is to be fitted.
    """
    choice = choice.model_copy(update={"stamps": _stamps(choice), "started": now()})
    for session in sessions_in(folder)[0]:
        if session.choice.model_copy(update={"started": choice.started}) == choice:
            return session
    if not choice.recordings:
        raise InputError("no recording was chosen; choose at least one for training")
    both = [name for name in choice.recordings if name in choice.validation]
    if both:
        raise InputError(f"{both[0]}: chosen for training and for validation; a recording can be one of both")
    taken = {path.name for path in folder.glob("session_*")}
    number = next(k for k in range(1, len(taken) + 2) if f"session_{k}" not in taken)
    own = folder / f"session_{number}"
    own.mkdir(parents=True)
    write_text(own / "session.yaml", to_yaml(choice.model_dump(by_alias=True)))
    return Session(own, choice)


def _stamps(choice: Choice) -> list[str]:
    """Return size and date of the files of all recordings and of the model; InputError where one isn't there."""
    names = [*choice.recordings, *choice.validation, *([choice.model] if choice.model else [])]
    out = []
    for name in names:
        path = Path(choice.folder, name)
        if not path.exists():
            raise InputError(f"{name}: there is no such file or folder")
        files = [file.stat() for file in sorted(path.rglob("*")) if file.is_file()] if path.is_dir() else [path.stat()]
        out.append(f"{sum(file.st_size for file in files)} {max((file.st_mtime_ns for file in files), default=0)}")
    return out


def model_name(session: Session, count: int) -> str:
    """Return the file that holds the model after so many additions."""
    return session.choice.model if count == 0 and session.choice.model else f"model_step_{count}.yaml"


def command_lines(session: Session, number: int) -> list[str]:
    """Return the commands, to be run in the folder of the session's start, that lead to a step's model and report."""
    choice, bags = session.choice, session.choice.recordings
    unseen = [word for name in choice.validation for word in ("--validation", name)]
    more = ["--topic", choice.topic] if choice.topic else []
    more += [word for path in choice.effects_from for word in ("--effects-from", path)]
    added = session.added(number)
    models = [model_name(session, count) for count in range(len(added) + 1)]
    lines = [["cd", choice.folder]]
    if choice.model is None:
        robot = ["--robot", choice.robot] if choice.robot else []
        lines.append(["robot_ident", "identify", *bags, *robot, *more, "-o", models[0]])
    lines.append(["robot_ident", "compare", models[0], *bags, *more])
    for label, before, after in zip(added, models, models[1:], strict=False):
        lines.append(["robot_ident", "diagnose", before, *bags, *unseen, *more])
        lines.append(["robot_ident", "add", before, label, "--bag", *bags, *unseen, *more, "-o", after])
    lines.append(["robot_ident", "report", *models, "--bag", *bags, *unseen, *more, "-o", "report.html"])
    return [shlex.join(line) for line in lines]


def script(session: Session, number: int) -> str:
    """Return the commands as a shell script."""
    return "\n".join(["#!/bin/sh", "set -e", *command_lines(session, number), ""])
