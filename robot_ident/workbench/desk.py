"""What the server holds: the folder of sessions, their workers, and which files may be touched."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from robot_ident.bags import read_for
from robot_ident.errors import InputError
from robot_ident.model.model_file import read_model
from robot_ident.recording.process import process
from robot_ident.robot import load_robot
from robot_ident.workbench.jobs import Jobs
from robot_ident.workbench.made import Made
from robot_ident.workbench.paths import BUILT_IN, Allowed
from robot_ident.workbench.roles import Seen
from robot_ident.workbench.session import Choice, Session, begin, sessions_in

_NAME = re.compile(r"session_[0-9]{1,6}")


class Desk:
    """folder: where sessions are kept. robot, topic, effects_from: of new sessions, as told on the command line."""

    def __init__(
        self,
        folder: Path,
        allowed: Allowed,
        *,
        robot: str | None = None,
        topic: str | None = None,
        effects_from: Sequence[str] = (),
    ) -> None:
        self.folder, self.allowed = folder, allowed
        self.robot, self.topic, self.effects_from = robot, topic, effects_from
        self.made = Made()
        self._jobs: dict[str, Jobs] = {}
        self._lock, self._reading = threading.Lock(), threading.Lock()
        self._seen: dict[tuple[str, str | None, str | None, int], Seen] = {}

    @property
    def sessions(self) -> tuple[list[Session], list[str]]:
        """The sessions of the folder, the newest first, and what is wrong with those that can't be opened."""
        return sessions_in(self.folder)

    def session(self, name: str) -> Session:
        """Return a session by its name; InputError where there is none, or one that would run or write what nobody
        named on the command line.
        """
        if not _NAME.fullmatch(name) or not (self.folder / name / "session.yaml").is_file():
            raise InputError(f"{name[:40]}: there is no such session")
        found = Session.open(self.folder / name)
        found.refuse_links()
        found.own_effects(self.effects_from)
        return found

    def jobs(self, session: Session) -> Jobs:
        """Return the worker of a session; the first time, sweep up and compute what a broken-off program left open."""
        with self._lock:
            if session.name not in self._jobs:
                session.sweep()
                self._jobs[session.name] = Jobs(session.folder, self.effects_from, self.made.note)
                if not session.steps:
                    self._jobs[session.name].start({"task": "open"})
            return self._jobs[session.name]

    def open(
        self,
        recordings: Sequence[str],
        validation: Sequence[str] = (),
        model: str | None = None,
        robot: str | None = None,
    ) -> Session:
        """Return the session on recordings and a model, begun now or earlier; InputError on paths out of bounds.

        robot: of a model that is identified first; None = as told on the command line.
        """
        for name in (*recordings, *validation, *([model] if model else [])):
            self.allowed.checked(name)
        self.robot_file(robot)
        choice = Choice(
            folder=str(self.allowed.root),
            recordings=list(recordings),
            validation=list(validation),
            model=model or None,
            robot=None if model else robot or self.robot,
            topic=self.topic,
            effects_from=list(self.effects_from),
        )
        found = begin(self.folder, choice)
        found.refuse_links()
        return found

    def robot_file(self, robot: str | None) -> str:
        """Return the robot that a browser named, or the one of the command line: by its name, or as a path."""
        if robot is None or robot == self.robot or robot in BUILT_IN:
            return self._named_robot(robot or self.robot or BUILT_IN[0])
        return str(self.allowed.checked(robot))

    def _named_robot(self, robot: str) -> str:
        path = Path(self.allowed.root, robot)
        return str(path) if path.is_file() else robot

    def looked_at(self, name: str, robot: str | None, model: str | None) -> Seen:
        """Return what a recording holds; InputError where it can't be used with the robot."""
        path = self.allowed.checked(name)
        key = (name, robot, model, path.stat().st_mtime_ns if path.exists() else 0)
        with self._reading:  # one after the other: each of them takes a processor
            if key not in self._seen:
                found = read_model(self.allowed.checked(model)).robot if model else load_robot(self.robot_file(robot))
                read = read_for(path, found, topic=self.topic)
                self._seen[key] = Seen.of(process(replace(read, source=name), found))
            return self._seen[key]

    def close(self) -> None:
        """End all workers."""
        with self._lock:
            for jobs in self._jobs.values():
                jobs.close()
