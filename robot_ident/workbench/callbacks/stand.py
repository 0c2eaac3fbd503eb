"""Where a session stands, as the page keeps it and asks for it again and again."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from robot_ident.workbench.desk import Desk
from robot_ident.workbench.session import Session


def now(desk: Desk, session: Session) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return where a session stands (the step, what of it the pictures show, the task under way), and how far that
    task is.
    """
    job = desk.jobs(session).look()
    steps = session.steps
    folder = session.step_folder(session.here)
    known = sorted(path.name for path in folder.glob("*.json"))
    drawn = f"{session.name} {session.here} {len(steps)} {','.join(known)}"
    stand = {"session": session.name, "step": session.here, "drawn": drawn, "job": [job.number, job.state]}
    return stand, {key: value for key, value in asdict(job).items() if key != "task"}
