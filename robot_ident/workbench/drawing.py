"""Fills the panels and draws the pictures whenever a session moves on or something else is looked at."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.signals.motion import Mask
from robot_ident.workbench import panels
from robot_ident.workbench.brushing import Condition, brushed, held
from robot_ident.workbench.callbacks import Stand, looked_at
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.layout import REDO, UNDO
from robot_ident.workbench.next_step import next_step
from robot_ident.workbench.pictures import (
    Shade,
    over_time,
    over_time_told,
    scatter,
    scatter_told,
    spectrum,
    spectrum_told,
    staircase,
    staircase_told,
)
from robot_ident.workbench.session import command_lines
from robot_ident.workbench.view import View

_SLOW = 0.1  # of the time: what "low speed" brushes


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks that fill panels and pictures."""
    for part in (_register_brushing, _register_panels, _register_pictures):
        part(app, desk)


def _register_brushing(app: Dash, desk: Desk) -> None:
    """Register the callback of what is brushed."""

    @app.callback(
        Output("brush", "data", allow_duplicate=True),
        Input("brushing", "data"),
        State("brush", "data"),
        State("joint", "data"),
        State("recording", "data"),
        State("over", "value"),
        State("stand", "data"),
        prevent_initial_call=True,
    )
    def brush(done: dict[str, Any] | None, before: Any, joint: Any, recording: int, over: str, stand: Stand) -> Any:
        view, place = _shown(desk, stand, joint)
        if not done:
            raise PreventUpdate
        cause = done["of"]
        if isinstance(cause, dict):
            return _clicked(view, place, cause, before)
        span = _span(done["value"])
        if span is None:
            raise PreventUpdate
        axis, lower, upper = span
        if cause == "time":
            return _with(before, Condition("time", lower, upper, recording))
        variable = ("velocity", "position", over)[axis]
        return _with(before, Condition(f"{variable} of {view.joints[place]}", lower, upper))


def _shown(desk: Desk, stand: Stand, joint: int | None = None) -> tuple[View, int]:
    """Return the step and the joint that a page looks at; nothing is drawn as long as there is no step."""
    view = looked_at(desk, stand)
    if view is None:
        raise PreventUpdate
    return view, view.focus if joint is None else joint


def _clicked(view: View, joint: int, cause: dict[str, Any], before: list[dict[str, Any]]) -> Any:
    """Return the regions after a click: on a sentence, on one that is let go, on `low speed` or `clear`."""
    if "drop" in cause:
        return [one for k, one in enumerate(before) if k != cause["drop"]]
    if "region" in cause:
        return [asdict(_region(view, joint, int(cause["region"])))]
    if cause["brush"] == "clear":
        return []
    speeds = np.concatenate([np.abs(view.rows[k].dq[:, joint]) for k in view.training])
    slow = float(np.quantile(speeds, _SLOW))
    return _with(before, Condition(f"velocity of {view.joints[joint]}", -slow, slow))


def _region(view: View, joint: int, number: int) -> Condition:
    """Return one of the regions that `compare` names, as a condition."""
    found = view.comparison["joints"][joint]["worst"][number]
    what, source = str(found["what"]), found.get("recording")
    place = next((k for k, one in enumerate(view.recordings) if one["name"] == source), None)
    if what != "time" and " of " not in what:
        what = f"{what} of {view.joints[joint]}"
    return Condition(what, float(found["from"]), float(found["to"]), place)


def _span(selected: dict[str, Any]) -> tuple[int, float, float] | None:
    """Return which picture of a row was dragged across, and from where to where."""
    for key, ends in selected.get("range", {}).items():
        if key.startswith("x"):
            return int(key[1:] or 1) - 1, float(min(ends)), float(max(ends))
    return None


def _with(before: list[dict[str, Any]], added: Condition) -> list[dict[str, Any]]:
    """Return the regions with one more; of one variable the latest holds."""
    return [*(one for one in before if one["variable"] != added.variable), asdict(added)]


def _register_panels(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the panels."""

    @app.callback(
        Output("stages", "children"),
        Output("next", "children"),
        Output(UNDO, "disabled"),
        Output(REDO, "disabled"),
        Output("bench", "hidden"),
        Input("stand", "data"),
        Input("overlays", "data"),
    )
    def guidance(stand: Stand, keys: list[str]) -> tuple[Any, ...]:
        if stand is None:
            return [], [], True, True, True
        session = desk.session(stand["session"])
        job = desk.jobs(session).look()
        view = looked_at(desk, stand)
        step = next_step(view, job, [] if view is None else view.overlays(keys))
        told = panels.stages(step), panels.next_step(step, job.running)
        if view is None:
            return *told, True, True, True
        first = session.steps[view.number].parent is None
        return *told, first or job.running, not session.can_redo or job.running, False

    @app.callback(
        Output("candidates", "children"),
        Output("beside", "children"),
        Output("steps", "children"),
        Input("drawn", "data"),
        Input("overlays", "data"),
        Input("running", "data"),
        State("stand", "data"),
    )
    def deeds(_drawn: str | None, keys: list[str], running: bool, stand: Stand) -> tuple[list[Any], ...]:
        view, _ = _shown(desk, stand)
        beside = panels.side_by_side(view, view.overlays(keys), running)
        return panels.candidates(view, keys, running), beside, panels.tree(view, keys)

    @app.callback(
        Output("joints", "children"),
        Output("focus", "data"),
        Output("recordings", "children"),
        Output("commands", "children"),
        Output("other", "options"),
        Input("drawn", "data"),
        State("stand", "data"),
    )
    def step(_drawn: str | None, stand: Stand) -> tuple[Any, ...]:
        view, _ = _shown(desk, stand)
        lines = "\n".join(command_lines(view.session, view.number))
        others = [label for label in view.comparison["possible"] if label not in view.previews]
        return panels.joint_cards(view), view.focus, panels.recording_buttons(view), lines, others

    @app.callback(Output("where", "children"), Input("drawn", "data"), Input("joint", "data"), State("stand", "data"))
    def failure(_drawn: str | None, joint: int | None, stand: Stand) -> list[Any]:
        return panels.where(*_shown(desk, stand, joint))

    @app.callback(
        Output("brushed", "children"),
        Input("drawn", "data"),
        Input("joint", "data"),
        Input("brush", "data"),
        State("stand", "data"),
    )
    def brush(_drawn: str | None, joint: int | None, data: list[dict[str, Any]], stand: Stand) -> Any:
        view, place = _shown(desk, stand, joint)
        conditions, inside = _brushed(view, place, data)
        if inside is None:
            return panels.brushed(view, place, [], None)
        seen = view.training
        found = held([inside[k] for k in seen], [view.rows[k] for k in seen], [view.residual[k] for k in seen], place)
        return panels.brushed(view, place, conditions, found)


_CHANGES = (Input("drawn", "data"), Input("joint", "data"), Input("overlays", "data"), Input("shade", "data"))
_STAND = State("stand", "data")


def _register_pictures(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the pictures."""

    def shown(stand: Stand, joint: int | None, shade: Shade | None) -> tuple[View, int]:
        if shade is None:
            raise PreventUpdate
        return _shown(desk, stand, joint)

    @app.callback(*_outputs("time"), *_CHANGES, Input("recording", "data"), Input("brush", "data"), _STAND)
    def time(
        _drawn: str, joint: int | None, keys: list[str], shade: Shade, recording: int, brush: list[Any], stand: Stand
    ) -> Any:
        view, place = shown(stand, joint, shade)
        conditions, inside = _brushed(view, place, brush)
        figure = over_time(view, place, recording, view.overlays(keys), inside, conditions, shade)
        return figure, over_time_told(view, place, recording)

    @app.callback(*_outputs("scatter"), *_CHANGES, Input("over", "value"), Input("brush", "data"), _STAND)
    def clouds(
        _drawn: str, joint: int | None, keys: list[str], shade: Shade, over: str, brush: list[Any], stand: Stand
    ) -> Any:
        view, place = shown(stand, joint, shade)
        conditions, inside = _brushed(view, place, brush)
        variables = ("velocity", "position", over)
        figure = scatter(view, place, variables, view.overlays(keys), inside, conditions, shade)
        return figure, scatter_told(view, place)

    @app.callback(*_outputs("spectrum"), *_CHANGES, Input("recording", "data"), _STAND)
    def lines(_drawn: str, joint: int | None, keys: list[str], shade: Shade, recording: int, stand: Stand) -> Any:
        view, place = shown(stand, joint, shade)
        return spectrum(view, place, recording, view.overlays(keys), shade), spectrum_told(view, place, recording)

    @app.callback(*_outputs("staircase"), *_CHANGES, _STAND)
    def stairs(_drawn: str, joint: int | None, keys: list[str], shade: Shade, stand: Stand) -> Any:
        view, place = shown(stand, joint, shade)
        return staircase(view, place, view.overlays(keys), shade), staircase_told(view, place)


def _outputs(name: str) -> tuple[Output, Output]:
    """Return where a picture goes, and what it shows in words."""
    return Output(name, "figure"), Output(f"{name}_told", "children")


def _brushed(view: View, joint: int, data: list[dict[str, Any]]) -> tuple[list[Condition], list[Mask] | None]:
    conditions = [Condition.of(one) for one in data]
    if not conditions:
        return [], None
    return conditions, brushed(conditions, view.rows, view.loads, view.joints, joint)
