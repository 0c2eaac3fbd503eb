"""What is looked at: joint, recording, what is laid over, what is brushed."""

from __future__ import annotations

from typing import Any

import numpy as np
from dash import ALL, Dash, Input, Output, State, ctx, no_update
from dash.exceptions import PreventUpdate

from robot_ident.workbench.brush import Condition
from robot_ident.workbench.callbacks.looked import looked_at
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.view import View

_AT_ONCE = 2  # laid over at most
_SLOW = 0.1  # of the time: what "low speed" brushes


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of what is looked at."""
    for name in ("joint", "recording"):
        _pressed(app, name)

    @app.callback(
        Output("overlays", "data", allow_duplicate=True),
        Input({"tick": ALL}, "value"),
        State("overlays", "data"),
        prevent_initial_call=True,
    )
    def tick(_values: list[Any], overlays: list[str]) -> Any:
        if not isinstance(ctx.triggered_id, dict):
            raise PreventUpdate
        key = str(ctx.triggered_id["tick"])
        wanted = bool(ctx.triggered[0]["value"])
        if wanted == (key in overlays):
            return no_update
        return [*overlays, key][-_AT_ONCE:] if wanted else [one for one in overlays if one != key]

    @app.callback(
        Output("brush", "data", allow_duplicate=True),
        Input("time", "selectedData"),
        Input("scatter", "selectedData"),
        Input({"brush": ALL}, "n_clicks"),
        Input({"drop": ALL}, "n_clicks"),
        Input({"region": ALL}, "n_clicks"),
        State("brush", "data"),
        State("joint", "data"),
        State("recording", "data"),
        State("over", "value"),
        State("stand", "data"),
        prevent_initial_call=True,
    )
    def brush(*given: Any) -> Any:
        *_, before, joint, recording, over, stand = given
        view = looked_at(desk, stand)
        value, cause = ctx.triggered[0]["value"], ctx.triggered_id
        if view is None or not value or cause is None:
            raise PreventUpdate
        place = view.focus if joint is None else joint
        if isinstance(cause, dict):
            return _clicked(view, place, cause, before)
        span = _span(value)
        if span is None:
            raise PreventUpdate
        axis, lower, upper = span
        if cause == "time":
            return _with(before, Condition("time", lower, upper, recording))
        variable = ("velocity", "position", over)[axis]
        return _with(before, Condition(f"{variable} of {view.joints[place]}", lower, upper))


def _pressed(app: Dash, name: str) -> None:
    """A row of buttons, of which one is chosen."""

    @app.callback(Output(name, "data", allow_duplicate=True), Input({name: ALL}, "n_clicks"), prevent_initial_call=True)
    def choose(_clicks: list[Any]) -> Any:
        if not isinstance(ctx.triggered_id, dict) or not ctx.triggered[0]["value"]:
            raise PreventUpdate
        return ctx.triggered_id[name]


def _clicked(view: View, joint: int, cause: dict[str, Any], before: list[dict[str, Any]]) -> Any:
    """Return the regions after a click: on a sentence, on one that is let go, on `low speed` or `clear`."""
    if "drop" in cause:
        return [one for k, one in enumerate(before) if k != cause["drop"]]
    if "region" in cause:
        return [_region(view, joint, int(cause["region"])).to_dict()]
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
    return [*(one for one in before if one["variable"] != added.variable), added.to_dict()]
