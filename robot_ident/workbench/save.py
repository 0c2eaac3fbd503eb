"""Saves what a step holds under a name below the folder of the start."""

from __future__ import annotations

from pathlib import Path

from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.workbench.commands import script
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.session import Session


def save(desk: Desk, session: Session, what: str, name: str, *, force: bool) -> str:
    """Write the model, the report or the command lines of the present step; return what is to be said.

    Raises InputError on a name out of bounds, or one that is taken where `force` isn't given.
    """
    path = target(desk, name, force=force)
    shown = desk.allowed.shown(path)
    if what == "report":
        desk.jobs(session).start(
            {"task": "report", "number": session.here, "path": str(path), "shown": shown, "force": force}
        )
        return f"Writing {shown}; the line under the next step says when it is there."
    text = script(session, session.here) if what == "commands" else session.model_file(session.here).read_text("utf-8")
    write_text(path, text, force=force)
    return f"Saved: {shown} (step {session.here})"


def target(desk: Desk, name: str, *, force: bool) -> Path:
    """Return where a name lies; InputError where nothing may be written there."""
    if not name.strip():
        raise InputError("give the file a name first")
    path = desk.allowed.checked(name.strip())
    if path.is_dir():
        raise InputError(f"{name}: is a folder; name a file")
    if path.exists() and not force:
        raise InputError(f"{name} exists already; give another name, or tick “replace a file that is there”")
    if not path.parent.is_dir():
        raise InputError(f"{name}: the folder {desk.allowed.shown(path.parent)} does not exist")
    return path
