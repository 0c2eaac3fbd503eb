"""Pages, and how far the computing is."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, Output, State, html, no_update

from robot_ident.errors import InputError
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.jobs import Job
from robot_ident.workbench.pages import chooser
from robot_ident.workbench.panels import guide
from robot_ident.workbench.session import Session

# ms between looks at the work. It never stops on a session's page: answers may overtake each other, and another page
# may have begun something.
BUSY, IDLE = 300, 1500


def stand_of(desk: Desk, session: Session) -> dict[str, Any]:
    """Return where a session stands: the step, what of it the pictures show, and the task under way."""
    job = desk.jobs(session).look()
    steps = session.steps
    folder = session.step_folder(session.here)
    known = sorted(path.name for path in folder.glob("*.json"))
    drawn = f"{session.name} {session.here} {len(steps)} {','.join(known)}"
    return {"session": session.name, "step": session.here, "drawn": drawn, "job": [job.number, job.state]}


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of pages and progress."""

    @app.callback(
        Output("page", "children"),
        Output("session", "hidden"),
        Output("opened", "children"),
        Output("stand", "data"),
        Output("tick", "disabled"),
        Output("joint", "data"),
        Output("recording", "data"),
        Output("overlays", "data"),
        Output("brush", "data"),
        Input("address", "pathname"),
    )
    def show(path: str | None) -> tuple[Any, ...]:
        afresh: tuple[Any, ...] = (None, 0, [], [])
        name = (path or "/").strip("/")
        if not name:
            return chooser(desk), True, "", None, True, *afresh
        try:
            session = desk.session(name)
            desk.jobs(session)
        except InputError as error:
            return [html.P(str(error), className="wrong"), *chooser(desk)], True, "", None, True, *afresh
        return [], False, _opened(session), stand_of(desk, session), False, *afresh

    @app.callback(
        Output("job", "children"),
        Output("tick", "interval"),
        Output("stand", "data", allow_duplicate=True),
        Output("overlays", "data", allow_duplicate=True),
        Input("tick", "n_intervals"),
        State("stand", "data"),
        prevent_initial_call=True,
    )
    def tick(_count: int, stand: dict[str, Any] | None) -> tuple[Any, ...]:
        if stand is None:
            return [], IDLE, no_update, no_update
        session = desk.session(stand["session"])
        job: Job = desk.jobs(session).look()
        now = stand_of(desk, session)
        overlays: Any = no_update if now["step"] == stand["step"] else []
        return guide.job(job), BUSY if job.running else IDLE, no_update if now == stand else now, overlays

    @app.callback(Output("drawn", "data"), Input("stand", "data"), State("drawn", "data"))
    def drawn(stand: dict[str, Any] | None, before: str | None) -> Any:
        now = stand["drawn"] if stand else None
        return no_update if now == before else now


def _opened(session: Session) -> str:
    choice = session.choice
    unseen = f"; validation {', '.join(choice.validation)}" if choice.validation else ""
    return f"{session.name}: {', '.join(choice.recordings)}{unseen}"
