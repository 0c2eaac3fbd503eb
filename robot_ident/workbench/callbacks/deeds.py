"""What changes a session: open, diagnose, look at a candidate, add, undo, redo, go, save, cancel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from dash import ALL, Dash, Input, Output, State, html, no_update
from dash.exceptions import PreventUpdate

from robot_ident.errors import InputError
from robot_ident.workbench.callbacks.stand import now
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.save import save
from robot_ident.workbench.session import Session
from robot_ident.workbench.view import CANDIDATE


@dataclass
class Page:
    """What the page held when a button was pressed, and what the deed changes of it."""

    label: str
    fields: Mapping[str, Any]
    overlays: list[str]
    said: str = ""
    saved: str | html.Span = ""


def register(app: Dash, desk: Desk) -> None:
    """Register the one callback of all deeds."""

    @app.callback(
        Output("stand", "data", allow_duplicate=True),
        Output("task", "data", allow_duplicate=True),
        Output("overlays", "data", allow_duplicate=True),
        Output("said", "children"),
        Output("saved", "children"),
        Input("pressed", "data"),
        State("stand", "data"),
        State("overlays", "data"),
        State({"name": ALL}, "value"),
        State({"name": ALL}, "id"),
        State("other", "value"),
        State("replace", "value"),
        prevent_initial_call=True,
    )
    def pressed(
        click: dict[str, Any],
        stand: dict[str, Any],
        overlays: list[str],
        names: Any,
        ids: Any,
        other: Any,
        replace: Any,
    ) -> tuple[Any, ...]:
        if not click or stand is None:
            raise PreventUpdate
        cause = click["of"]
        fields = {one["name"]: value for one, value in zip(ids, names, strict=True)}
        fields |= {"other": other, "replace": bool(replace)}
        page = Page(str(cause["label"]), fields, overlays)
        try:
            session = desk.session(stand["session"])
        except InputError as error:
            return no_update, no_update, no_update, str(error), ""
        try:
            if cause["do"] in MOVES and desk.jobs(session).look().running:
                raise InputError("something is being computed; wait for it, or cancel it")
            DEEDS[cause["do"]](desk, session, page)
        except InputError as error:
            if cause["do"].startswith("save "):  # of the buttons that stand beside the names
                page.saved = html.Span(str(error), className="wrong")
            else:
                page.said = str(error)
        stand, job = now(desk, session)
        return stand, job, page.overlays, page.said, page.saved


def _open(desk: Desk, session: Session, page: Page) -> None:
    desk.jobs(session).start({"task": "open"})


def _diagnose(desk: Desk, session: Session, page: Page) -> None:
    desk.jobs(session).start({"task": "diagnose", "number": session.here})


def _look(desk: Desk, session: Session, page: Page) -> None:
    page.overlays = [f"{CANDIDATE}{page.label}"]


def _preview(desk: Desk, session: Session, page: Page) -> None:
    label = page.fields["other"]
    if not label:
        raise InputError("choose an effect first")
    desk.jobs(session).start({"task": "preview", "number": session.here, "label": label})
    page.overlays = [*page.overlays, f"{CANDIDATE}{label}"][-2:]


def _add(desk: Desk, session: Session, page: Page) -> None:
    there = session.find(session.here, page.label)
    if there is not None:
        session.go(there)
        page.overlays = []
        return
    new = session.next_number()
    desk.jobs(session).start({"task": "add", "number": session.here, "label": page.label, "new": new})


def _undo(desk: Desk, session: Session, page: Page) -> None:
    session.undo()
    page.overlays = []


def _redo(desk: Desk, session: Session, page: Page) -> None:
    session.redo()
    page.overlays = []


def _go(desk: Desk, session: Session, page: Page) -> None:
    session.go(int(page.label))
    page.overlays = []


def _cancel(desk: Desk, session: Session, page: Page) -> None:
    desk.jobs(session).cancel()


def _save(what: str) -> Callable[[Desk, Session, Page], None]:
    def deed(desk: Desk, session: Session, page: Page) -> None:
        name = str(page.fields.get(what) or "")
        page.saved = save(desk, session, what, name, force=bool(page.fields["replace"]))

    return deed


DEEDS: dict[str, Callable[[Desk, Session, Page], None]] = {
    "open": _open,
    "diagnose": _diagnose,
    "look": _look,
    "preview": _preview,
    "add": _add,
    "undo": _undo,
    "redo": _redo,
    "go": _go,
    "cancel": _cancel,
    "save": _save("model"),
    "save model": _save("model"),
    "save report": _save("report"),
    "save commands": _save("commands"),
}

MOVES = ("undo", "redo", "go")
"""Deeds that wait for what is being computed."""
