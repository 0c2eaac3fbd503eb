"""What the server holds: the folder of sessions, their workers, and which files may be touched."""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from pathlib import Path

from robot_ident.errors import InputError
from robot_ident.workbench.jobs import Jobs
from robot_ident.workbench.paths import Allowed
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
        self._jobs: dict[str, Jobs] = {}
        self._lock = threading.Lock()

    @property
    def sessions(self) -> list[Session]:
        """The sessions of the folder, the newest first."""
        return sessions_in(self.folder) if self.folder.is_dir() else []

    def session(self, name: str) -> Session:
        """Return a session by its name; InputError where there is none."""
        if not _NAME.fullmatch(name) or not (self.folder / name / "session.yaml").is_file():
            raise InputError(f"{name[:40]}: there is no such session")
        return Session.open(self.folder / name)

    def jobs(self, session: Session) -> Jobs:
        """Return the worker of a session; the first time, sweep up and compute what a broken-off program left open."""
        with self._lock:
            if session.name not in self._jobs:
                session.sweep()
                self._jobs[session.name] = Jobs(session.folder)
                if not session.steps:
                    self._jobs[session.name].start({"task": "open"})
            return self._jobs[session.name]

    def open(self, recordings: Sequence[str], validation: Sequence[str] = (), model: str | None = None) -> Session:
        """Return the session on recordings and a model, begun now or earlier; InputError on paths out of bounds."""
        for name in (*recordings, *validation, *([model] if model else [])):
            self.allowed.checked(name)
        choice = Choice(
            folder=str(self.allowed.root),
            recordings=list(recordings),
            validation=list(validation),
            model=model or None,
            robot=None if model else self.robot,
            topic=self.topic,
            effects_from=list(self.effects_from),
        )
        return begin(self.folder, choice)

    def close(self) -> None:
        """End all workers."""
        with self._lock:
            for jobs in self._jobs.values():
                jobs.close()
