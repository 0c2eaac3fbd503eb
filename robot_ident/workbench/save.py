"""Saves what a step holds under a new name below the folder of the start; what was saved here before is all that it may
replace.
"""

from __future__ import annotations

import os
from pathlib import Path, PurePath

from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.workbench.commands import script
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.made import stamp
from robot_ident.workbench.paths import RECORDINGS, is_recording
from robot_ident.workbench.session import Session

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
        shown, own = desk.allowed.shown(path), desk.made.still(path)
        if what == "report":
            desk.jobs(session).start(
                {"task": "report", "number": session.here, "path": str(path), "shown": shown, "left": own}
            )
            return f"Writing {shown}; the line under the next step says when it is there."
        here = session.here
        text = script(session, here) if what == "commands" else session.model_file(here).read_text("utf-8")
        _write(path, shown, text, force=own is not None)
        desk.made.note(path, stamp(path))
    except (OSError, ValueError, RuntimeError) as error:  # also of names that no file can have, and of circles of links
        reason = getattr(error, "strerror", None) or "no file can have this name"
        raise InputError(f"{name} was not saved: {reason}; give another name") from error
    return f"Saved: {shown} (step {here})"


def _write(path: Path, shown: str, text: str, *, force: bool) -> None:
    try:
        write_text(path, text, force=force)
    except InputError as error:
        reason = getattr(error.__cause__, "strerror", None) or str(error)
        raise InputError(f"{shown} was not saved: {reason}; make room, or name a file in another folder") from error


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
        if desk.made.still(path) is None:
            raise InputError(f"{name} exists already and was not saved by this workbench; give another name")
        if not force:
            raise InputError(f"{name} exists already; give another name, or tick “replace what was saved here before”")
    if not path.parent.is_dir():
        raise InputError(f"{name}: the folder {desk.allowed.shown(path.parent)} does not exist; give another name")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{name}: the folder of this file can't be written to; give a name in another folder")
    return path
