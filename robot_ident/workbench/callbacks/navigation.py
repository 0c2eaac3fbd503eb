"""Pages, and how far the computing is."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, Output, State, html, no_update
from flask import abort

from robot_ident.errors import InputError
from robot_ident.workbench.callbacks.stand import now
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.pages import chooser
from robot_ident.workbench.session import Session


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of pages and progress."""

    @app.callback(
        Output("page", "children"),
        Output("session", "hidden"),
        Output("opened", "children"),
        Output("stand", "data"),
        Output("task", "data"),
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
            return chooser(desk), True, "", None, None, *afresh
        try:
            session = desk.session(name)
        except InputError as error:
            return [html.P(str(error), className="wrong"), *chooser(desk)], True, "", None, None, *afresh
        return [], False, _opened(session), *now(desk, session), *afresh

    def tell(name: str) -> dict[str, Any]:
        """Answer a page that asks how its session stands."""
        try:
            stand, job = now(desk, desk.session(name))
        except InputError as error:
            abort(404, str(error))
        return {"stand": stand, "job": job}

    app.server.add_url_rule("/_now/<name>", view_func=tell)

    @app.callback(Output("drawn", "data"), Input("stand", "data"), State("drawn", "data"))
    def drawn(stand: dict[str, Any] | None, before: str | None) -> Any:
        known = stand["drawn"] if stand else None
        return no_update if known == before else known


def _opened(session: Session) -> str:
    choice = session.choice
    unseen = f"; validation {', '.join(choice.validation)}" if choice.validation else ""
    return f"{session.name}: {', '.join(choice.recordings)}{unseen}"
