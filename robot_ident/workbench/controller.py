"""What the server holds: the folder of sessions, their workers, and which files may be touched; it saves what a step
holds under a new name below the folder of the start.
"""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath

from robot_ident.bags import read_for
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.model.model_file import read_model
from robot_ident.recording.process import process
from robot_ident.robot import load_robot
from robot_ident.workbench.allowed_paths import BUILT_IN, RECORDINGS, Allowed, Stamp, is_recording, stamp
from robot_ident.workbench.file_roles import Seen
from robot_ident.workbench.jobs import Jobs
from robot_ident.workbench.session import Choice, Session, begin, script, sessions_in

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
        self.made: dict[Path, Stamp | None] = {}  # files that were saved, and how they were left
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
                self._jobs[session.name] = Jobs(session.folder, self.effects_from, self.made.__setitem__)
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
            name = robot or self.robot or BUILT_IN[0]
            path = Path(self.allowed.root, name)
            return str(path) if path.is_file() else name
        return str(self.allowed.checked(robot))

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

    def still(self, path: Path) -> Stamp | None:
        """Return the stamp of a file that was saved here and is as it was left; None for any other."""
        left = self.made.get(path)
        return left if left is not None and stamp(path) == left else None

    def close(self) -> None:
        """End all workers."""
        with self._lock:
            for jobs in self._jobs.values():
                jobs.close()


_READ_WITH_A_RECORDING = (*RECORDINGS, ".conditions.yaml")


def save(desk: Desk, session: Session, what: str, name: str, *, force: bool) -> str:
    """Write the model, the report or the command lines of the present step; return what is to be said.

    force: replace a file that was saved here before. Raises InputError on a name where nothing may be written, and
    where the writing fails.
    """
    desk.jobs(session).look()  # a report that is done is one that was saved
    name = name.strip()
    try:
        path = target(desk, name, force=force)
        shown, own = desk.allowed.shown(path), desk.still(path)
        if what == "report":
            desk.jobs(session).start(
                {"task": "report", "number": session.here, "path": str(path), "shown": shown, "left": own}
            )
            return f"Writing {shown}; the line under the next step says when it is there."
        here = session.here
        text = script(session, here) if what == "commands" else session.model_file(here).read_text("utf-8")
        try:
            write_text(path, text, force=own is not None)
        except InputError as error:
            reason = getattr(error.__cause__, "strerror", None) or str(error)
            told = f"{shown} was not saved: {reason}; make room, or name a file in another folder"
            raise InputError(told) from error
        desk.made[path] = stamp(path)
    except (OSError, ValueError, RuntimeError) as error:  # also of names that no file can have, and of circles of links
        reason = getattr(error, "strerror", None) or "no file can have this name"
        raise InputError(f"{name} was not saved: {reason}; give another name") from error
    return f"Saved: {shown} (step {here})"


def target(desk: Desk, name: str, *, force: bool) -> Path:
    """Return where a name lies, links followed; InputError where nothing may be written there."""
    if not name:
        raise InputError("give the file a name first")
    path = desk.allowed.below(name)
    inside = path.relative_to(desk.allowed.root)
    if any(part.startswith(".") and part != ".." for part in (*PurePath(name).parts, *inside.parts)):
        raise InputError(f"{name}: names starting with a dot are not written to; give another name")
    if path.is_dir():
        raise InputError(f"{name}: is a folder; name a file")
    if path.name.lower().endswith(_READ_WITH_A_RECORDING):
        raise InputError(f"{name}: is the name of a recording, which is never written to; give another ending")
    for folder in [path.parents[k] for k in range(len(inside.parts) - 1)]:
        if folder == desk.folder or (folder / "session.yaml").is_file():
            raise InputError(f"{name}: sessions are kept there; name a file in another folder")
        if is_recording(folder):
            raise InputError(f"{name}: {desk.allowed.shown(folder)} is a recording; name a file in another folder")
    if path.exists():
        if desk.still(path) is None:
            raise InputError(f"{name} exists already and was not saved by this workbench; give another name")
        if not force:
            raise InputError(f"{name} exists already; give another name, or tick “replace what was saved here before”")
    if not path.parent.is_dir():
        raise InputError(f"{name}: the folder {desk.allowed.shown(path.parent)} does not exist; give another name")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{name}: the folder of this file can't be written to; give a name in another folder")
    return path
