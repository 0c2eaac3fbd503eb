"""What is brushed."""

from __future__ import annotations

from typing import Any

import numpy as np
from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.workbench.brush import Condition
from robot_ident.workbench.callbacks.looked import looked_at
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.view import View

_SLOW = 0.1  # of the time: what "low speed" brushes


def register(app: Dash, desk: Desk) -> None:
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
    def brush(done: dict[str, Any] | None, before: Any, joint: Any, recording: int, over: str, stand: Any) -> Any:
        view = looked_at(desk, stand)
        if view is None or not done:
            raise PreventUpdate
        cause, place = done["of"], view.focus if joint is None else joint
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
