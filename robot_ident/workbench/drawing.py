"""Fills the panels and draws the pictures whenever a session moves on or something else is looked at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.workbench import panels, pictures
from robot_ident.workbench.brushing import Condition, Look
from robot_ident.workbench.callbacks import Stand, looked_at, parts
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.layout import REDO, UNDO
from robot_ident.workbench.next_step import next_step
from robot_ident.workbench.session import command_lines

_SLOW = 0.1  # of the time: what "low speed" brushes
_PICTURES: dict[str, tuple[Callable[[Look], Any], Callable[[Look], str], tuple[str, ...]]] = {
    "time": (pictures.over_time, pictures.over_time_told, ("recording", "brush")),
    "scatter": (pictures.scatter, pictures.scatter_told, ("over", "brush")),
    "spectrum": (pictures.spectrum, pictures.spectrum_told, ("recording",)),
    "staircase": (pictures.staircase, pictures.staircase_told, ()),
}
"""What draws each picture, what tells it in words, and what it changes with besides joint, overlays and shade."""


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of what is brushed, and those that fill panels and pictures."""
    drawn, stood = Input("drawn", "data"), State("stand", "data")

    def look(
        stand: Stand, joint: int | None = None, overlays: Sequence[str] = (), brush: Sequence[Any] = (), **more: Any
    ) -> Look:
        """Return what a page looks at; nothing is drawn as long as there is no step."""
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        joint = view.focus if joint is None else joint
        return Look(view, joint, overlays=view.overlays(overlays), conditions=[*map(Condition.of, brush)], **more)

    @app.callback(
        Output("brush", "data", allow_duplicate=True),
        Input("brushing", "data"),
        *parts(State, "brush.data", "joint.data", "recording.data", "over.value", "stand.data"),
        prevent_initial_call=True,
    )
    def brush(done: dict[str, Any] | None, before: Any, joint: Any, recording: int, over: str, stand: Stand) -> Any:
        at = look(stand, joint, recording=recording, over=over)
        if not done:
            raise PreventUpdate
        if isinstance(done["of"], dict):
            return _clicked(at, done["of"], before)
        return _with(before, _dragged(at, done["of"] == "time", done["value"]))

    @app.callback(
        *parts(Output, "stages.children", "next.children"),
        Output(UNDO, "disabled"),
        Output(REDO, "disabled"),
        Output("bench", "hidden"),
        *parts(Input, "stand.data", "overlays.data"),
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
        *parts(Output, "candidates.children", "beside.children", "steps.children"),
        drawn,
        *parts(Input, "overlays.data", "running.data"),
        stood,
    )
    def deeds(_drawn: str | None, keys: list[str], running: bool, stand: Stand) -> tuple[list[Any], ...]:
        at = look(stand, overlays=keys)
        beside = panels.side_by_side(at.view, at.overlays, running)
        return panels.candidates(at.view, keys, running), beside, panels.tree(at.view, keys)

    def filled(*places: str, by: Sequence[str] = ()) -> Callable[[Callable[[Look], Any]], None]:
        """Return a decorator of what fills parts of the page as soon as what it looks at has changed."""
        outputs = parts(Output, *places)

        def fill(made: Callable[[Look], Any]) -> None:
            @app.callback(
                outputs if len(outputs) > 1 else outputs[0],
                inputs={one: Input(one, "value" if one == "over" else "data") for one in ("drawn", *by)},
                state={"stand": stood},
            )
            def answer(drawn: str | None, **page: Any) -> Any:
                if page.get("shade", "light") is None:  # the page does not know yet whether it is dark
                    raise PreventUpdate
                return made(look(**page))

        return fill

    @filled("joints.children", "focus.data", "recordings.children", "commands.children", "other.options")
    def step(at: Look) -> tuple[Any, ...]:
        view, lines = at.view, "\n".join(command_lines(at.view.session, at.view.number))
        others = [label for label in view.comparison["possible"] if label not in view.previews]
        return panels.joint_cards(view), view.focus, panels.recording_buttons(view), lines, others

    filled("where.children", by=["joint"])(lambda at: panels.where(at.view, at.joint))
    filled("brushed.children", by=["joint", "brush"])(panels.brushed)
    for name, (picture, told, more) in _PICTURES.items():
        drawing = filled(f"{name}.figure", f"{name}_told.children", by=["joint", "overlays", "shade", *more])
        drawing(lambda at, picture=picture, told=told: (picture(at), told(at)))  # type: ignore[misc]


def _clicked(at: Look, cause: dict[str, Any], before: list[dict[str, Any]]) -> Any:
    """Return the regions after a click: on a sentence, on one that is let go, on `low speed` or `clear`."""
    if "drop" in cause:
        return [one for k, one in enumerate(before) if k != cause["drop"]]
    if "region" in cause:
        return [asdict(_region(at, int(cause["region"])))]
    if cause["brush"] == "clear":
        return []
    speeds = np.concatenate([np.abs(at.view.rows[k].dq[:, at.joint]) for k in at.view.training])
    slow = float(np.quantile(speeds, _SLOW))
    return _with(before, Condition(f"velocity of {at.name}", -slow, slow))


def _region(at: Look, number: int) -> Condition:
    """Return one of the regions that `compare` names, as a condition."""
    found = at.view.comparison["joints"][at.joint]["worst"][number]
    what, source = str(found["what"]), found.get("recording")
    place = next((k for k, one in enumerate(at.view.recordings) if one["name"] == source), None)
    if what != "time" and " of " not in what:
        what = f"{what} of {at.name}"
    return Condition(what, float(found["from"]), float(found["to"]), place)


def _dragged(at: Look, along_time: bool, selected: dict[str, Any]) -> Condition:
    """Return the region that was dragged across a picture, from one end to the other."""
    for key, ends in selected.get("range", {}).items():
        if key.startswith("x"):
            lower, upper = float(min(ends)), float(max(ends))
            if along_time:
                return Condition("time", lower, upper, at.recording)
            variable = ("velocity", "position", at.over)[int(key[1:] or 1) - 1]
            return Condition(f"{variable} of {at.name}", lower, upper)
    raise PreventUpdate


def _with(before: list[dict[str, Any]], added: Condition) -> list[dict[str, Any]]:
    """Return the regions with one more; of one variable the latest holds."""
    return [*(one for one in before if one["variable"] != added.variable), asdict(added)]
