"""What changes a session or the page: open, diagnose, look at a candidate, add, undo, redo, go, save, cancel."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, TypeVar

from dash import ALL, MATCH, ClientsideFunction, Dash, Input, Output, State, html, no_update
from dash.exceptions import PreventUpdate
from flask import abort

from robot_ident.errors import InputError, RobotIdentError
from robot_ident.workbench.controller import Desk, save
from robot_ident.workbench.file_roles import Seen, propose
from robot_ident.workbench.layout import chooser
from robot_ident.workbench.session import Session
from robot_ident.workbench.view import CANDIDATE, View

Stand = dict[str, Any] | None
"""Where a session stands, as the page keeps it; None on the first page."""

_Kind = TypeVar("_Kind", Input, Output, State)


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the session and of the pages."""
    _register_client(app)
    _register_session(app, desk)
    _register_pages(app, desk)


def parts(kind: type[_Kind], *names: str, **more: Any) -> list[_Kind]:
    """Return what a callback takes or gives: parts of the page like `stand.data`."""
    places = (name.split(".") for name in names)
    return [kind(place, what, **more) for place, what in places]


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


def _register_session(app: Dash, desk: Desk) -> None:
    """Register the one callback of all deeds."""

    @app.callback(
        *parts(Output, "stand.data", "task.data", "overlays.data", allow_duplicate=True),
        *parts(Output, "said.children", "saved.children"),
        Input("pressed", "data"),
        *parts(State, "stand.data", "overlays.data"),
        State({"name": ALL}, "value"),
        State({"name": ALL}, "id"),
        *parts(State, "other.value", "replace.value"),
        prevent_initial_call=True,
    )
    def pressed(
        click: dict[str, Any], stand: Stand, overlays: list[str], names: Any, ids: Any, other: Any, replace: Any
    ) -> tuple[Any, ...]:
        if not click or stand is None:
            raise PreventUpdate
        cause = click["of"]
        fields = {one["name"]: value for one, value in zip(ids, names, strict=True)}
        fields |= {"other": other, "replace": bool(replace)}
        said = ""
        saved: str | html.Span = ""
        try:
            session = desk.session(stand["session"])
        except InputError as error:
            return no_update, no_update, no_update, str(error), ""
        try:
            overlays, saved = _do(cause["do"], str(cause["label"]), fields, overlays, desk, session)
        except InputError as error:
            if cause["do"].startswith("save "):  # of the buttons that stand beside the names
                saved = html.Span(str(error), className="wrong")
            else:
                said = str(error)
        return *now(desk, session), overlays, said, saved


def _do(
    deed: str, label: str, fields: Mapping[str, Any], overlays: list[str], desk: Desk, session: Session
) -> tuple[list[str], str]:
    """Do what a button says; return what is laid over then, and what is said of a file that was saved.

    Raises InputError where it can't be done now.
    """
    jobs, here = desk.jobs(session), session.here
    moves: dict[str, Callable[[], None]] = {"undo": session.undo, "redo": session.redo}
    moves["go"] = lambda: session.go(int(label))
    if deed in moves:
        if jobs.look().running:
            raise InputError("something is being computed; wait for it, or cancel it")
        moves[deed]()
        return [], ""
    if deed == "add" and (there := session.find(here, label)) is not None:
        session.go(there)
        return [], ""
    if deed == "look":
        return [f"{CANDIDATE}{label}"], ""
    if deed == "preview":
        if not fields["other"]:
            raise InputError("choose an effect first")
        jobs.start({"task": "preview", "number": here, "label": fields["other"]})
        return [*overlays, f"{CANDIDATE}{fields['other']}"][-2:], ""
    if deed.partition(" ")[0] == "save":
        what = deed.partition(" ")[2] or "model"
        return overlays, save(desk, session, what, str(fields[what] or ""), force=fields["replace"])
    if deed == "cancel":
        jobs.cancel()
    elif deed == "open":
        jobs.start({"task": "open"})
    elif deed == "diagnose":
        jobs.start({"task": "diagnose", "number": here})
    elif deed == "add":
        jobs.start({"task": "add", "number": here, "label": label, "new": session.next_number()})
    else:
        raise InputError(f"{deed}: there is no such button")
    return overlays, ""


def looked_at(desk: Desk, stand: Stand) -> View | None:
    """Return the step that a page looks at, None as long as there is none."""
    return None if stand is None else View.of(desk.session(stand["session"]))


def _register_pages(app: Dash, desk: Desk) -> None:
    """Register the callbacks of pages and progress, and of the choice on the first page."""

    @app.callback(
        *parts(Output, "page.children", "session.hidden", "opened.children", "stand.data", "task.data"),
        *parts(Output, "joint.data", "recording.data", "overlays.data", "brush.data"),
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
        return [], False, f"{session.name}: {session.choice.in_words}", *now(desk, session), *afresh

    def tell(name: str) -> dict[str, Any]:
        """Answer a page that asks how its session stands."""
        try:
            stand, job = now(desk, desk.session(name))
        except InputError as error:
            abort(404, str(error))
        return {"stand": stand, "job": job}

    app.server.add_url_rule("/_now/<name>", view_func=tell)

    @app.callback(Output("drawn", "data"), Input("stand", "data"), State("drawn", "data"))
    def drawn(stand: Stand, before: str | None) -> Any:
        known = stand["drawn"] if stand else None
        return no_update if known == before else known

    @app.callback(
        *parts(Output, "address.pathname", "refused.children"),
        Input("begin", "n_clicks"),
        State({"role": ALL}, "value"),
        State({"role": ALL}, "id"),
        *parts(State, "brought.value", "robot.value"),
        prevent_initial_call=True,
    )
    def begin(
        clicks: int | None, roles: list[str], ids: list[dict[str, str]], model: str | None, robot: str | None
    ) -> tuple[Any, ...]:
        if not clicks:
            raise PreventUpdate
        chosen = {one["role"]: role for one, role in zip(ids, roles, strict=True)}
        training = [name for name, role in chosen.items() if role == "training"]
        validation = [name for name, role in chosen.items() if role == "validation"]
        try:
            return f"/{desk.open(training, validation, model, robot).name}", ""
        except InputError as error:
            return no_update, str(error)

    @app.callback(
        Output({"about": MATCH, "part": "words"}, "children"),
        Output({"about": MATCH, "part": "seen"}, "data"),
        *parts(Input, "robot.value", "brought.value"),
        State({"about": MATCH, "part": "words"}, "id"),
    )
    def look(robot: str | None, model: str | None, place: dict[str, str]) -> tuple[str, dict[str, Any]]:
        try:
            seen = desk.looked_at(place["about"], None if model else robot, model)
        except RobotIdentError as error:
            return str(error).removeprefix(f"{place['about']}: "), {"holds": None}
        return seen.in_words, {"holds": asdict(seen)}

    @app.callback(
        Output({"role": ALL}, "value"),
        Output("proposed", "children"),
        Input({"about": ALL, "part": "seen"}, "data"),
        State({"about": ALL, "part": "seen"}, "id"),
        State({"role": ALL}, "value"),
    )
    def proposal(looked: list[Any], ids: list[dict[str, str]], roles: list[str]) -> tuple[list[Any], Any]:
        if not looked or any(one is None for one in looked):
            raise PreventUpdate
        names = [one["about"] for one in ids]
        seen = {n: None if one["holds"] is None else Seen(**one["holds"]) for n, one in zip(names, looked, strict=True)}
        proposed, words = propose(seen)
        if any(role != "none" for role in roles):  # someone has chosen already
            return [no_update] * len(roles), no_update
        return [proposed[name] for name in names], words


def _register_client(app: Dash) -> None:
    """Register the callbacks that run in the browser."""

    def run(name: str, *places: Any, at_first: bool = True) -> None:
        function = ClientsideFunction("workbench", name)
        app.clientside_callback(function, *places, prevent_initial_call=not at_first)  # type: ignore[no-untyped-call]

    def clicks(*names: str) -> list[Input]:
        return [Input({name: ALL}, "n_clicks") for name in names]

    run("look", Output("shade", "data"), Input("look", "n_clicks"))
    for name in ("joint", "recording"):
        run("choose", Output(name, "data", allow_duplicate=True), *clicks(name), at_first=False)
        focus = [Input("focus", "data")] if name == "joint" else []
        run("mark", Output({name: ALL}, "aria-pressed"), Input(name, "data"), Input({name: ALL}, "id"), *focus)
    toggled = Output("overlays", "data", allow_duplicate=True)
    run("toggle", toggled, *clicks("tick"), State("overlays", "data"), at_first=False)
    run("ticked", Output({"tick": ALL}, "aria-checked"), Input("overlays", "data"), Input({"tick": ALL}, "id"))
    dragged = parts(Input, "time.selectedData", "scatter.selectedData")
    run("real", Output("brushing", "data"), *dragged, *clicks("brush", "drop", "region"), at_first=False)
    stood = Output("running", "data"), Output("said", "children", allow_duplicate=True)
    run("stood", *stood, Input("stand", "data"), State("running", "data"), at_first=False)
    told = ("told.children", "told.className", "fault.hidden", "trace.children")
    run("job", *parts(Output, "work.hidden", "progress.value", *told), Input("task", "data"))
