"""Fills the panels whenever a session moves on or something else is looked at."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.workbench.brush import Condition, brushed, held
from robot_ident.workbench.callbacks.looked import looked_at
from robot_ident.workbench.commands import command_lines
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.layout import REDO, UNDO
from robot_ident.workbench.panels import candidates, guide, joints, steps, where
from robot_ident.workbench.words import next_step


def register(app: Dash, desk: Desk) -> None:
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
    def guidance(stand: dict[str, Any] | None, keys: list[str]) -> tuple[Any, ...]:
        if stand is None:
            return [], [], True, True, True
        session = desk.session(stand["session"])
        job = desk.jobs(session).look()
        view = looked_at(desk, stand)
        step = next_step(view, job, [] if view is None else view.overlays(keys))
        told = guide.stages(step), guide.next_step(step, job.running)
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
    def deeds(
        _drawn: str | None, keys: list[str], running: bool, stand: dict[str, Any] | None
    ) -> tuple[list[Any], ...]:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        beside = steps.side_by_side(view, view.overlays(keys), running)
        return candidates.candidates(view, keys, running), beside, steps.tree(view, keys)

    @app.callback(
        Output("joints", "children"),
        Output("focus", "data"),
        Output("recordings", "children"),
        Output("commands", "children"),
        Output("other", "options"),
        Input("drawn", "data"),
        State("stand", "data"),
    )
    def step(_drawn: str | None, stand: dict[str, Any] | None) -> tuple[Any, ...]:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        lines = "\n".join(command_lines(view.session, view.number))
        others = candidates.others(view)
        return joints.joint_cards(view), view.focus, joints.recording_buttons(view), lines, others

    @app.callback(Output("where", "children"), Input("drawn", "data"), Input("joint", "data"), State("stand", "data"))
    def failure(_drawn: str | None, joint: int | None, stand: dict[str, Any] | None) -> list[Any]:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        return where.where(view, view.focus if joint is None else joint)

    @app.callback(
        Output("brushed", "children"),
        Input("drawn", "data"),
        Input("joint", "data"),
        Input("brush", "data"),
        State("stand", "data"),
    )
    def brush(_drawn: str | None, joint: int | None, data: list[dict[str, Any]], stand: dict[str, Any] | None) -> Any:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        place = view.focus if joint is None else joint
        conditions = [Condition.of(one) for one in data]
        if not conditions:
            return where.brushed(view, place, [], None)
        inside = brushed(conditions, view.rows, view.loads, view.joints, place)
        seen = view.training
        found = held([inside[k] for k in seen], [view.rows[k] for k in seen], [view.residual[k] for k in seen], place)
        return where.brushed(view, place, conditions, found)
