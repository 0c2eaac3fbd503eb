"""Fills the panels whenever a session moves on or something else is looked at."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.workbench.brush import Condition, brushed, held
from robot_ident.workbench.callbacks.looked import looked_at
from robot_ident.workbench.commands import command_lines
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.panels import candidates, guide, joints, steps, where
from robot_ident.workbench.panels.action import action
from robot_ident.workbench.words import next_step


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the panels."""

    @app.callback(
        Output("stages", "children"),
        Output("next", "children"),
        Output("backwards", "children"),
        Output("candidates", "children"),
        Output("beside", "children"),
        Output("steps", "children"),
        Output("bench", "hidden"),
        Input("stand", "data"),
        Input("joint", "data"),
        Input("overlays", "data"),
    )
    def deeds(stand: dict[str, Any] | None, joint: int | None, keys: list[str]) -> tuple[Any, ...]:
        if stand is None:
            raise PreventUpdate
        session = desk.session(stand["session"])
        job = desk.jobs(session).look()
        view = looked_at(desk, stand)
        if view is None:
            now = next_step(None, job, [])
            return guide.stages(now), guide.next_step(now, job.running), [], [], [], [], True
        overlays = view.overlays(keys)
        now = next_step(view, job, overlays)
        parent = session.steps[view.number].parent
        backwards = [
            action(
                "Undo", "undo", disabled=parent is None or job.running, title="look at the step before; nothing is lost"
            ),
            action("Redo", "redo", disabled=not session.can_redo or job.running, title="go forward again"),
        ]
        return (
            guide.stages(now),
            guide.next_step(now, job.running),
            backwards,
            candidates.candidates(view, keys, job.running),
            steps.side_by_side(view, overlays, job.running),
            steps.tree(view, keys),
            False,
        )

    @app.callback(
        Output("joints", "children"),
        Output("where", "children"),
        Output("commands", "children"),
        Input("drawn", "data"),
        Input("joint", "data"),
        State("stand", "data"),
    )
    def figures(_drawn: str | None, joint: int | None, stand: dict[str, Any] | None) -> tuple[Any, ...]:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        place = view.focus if joint is None else joint
        lines = "\n".join(command_lines(view.session, view.number))
        return joints.joint_cards(view, place), where.where(view, place), lines

    @app.callback(
        Output("recordings", "children"),
        Input("drawn", "data"),
        Input("recording", "data"),
        State("stand", "data"),
    )
    def recordings(_drawn: str | None, recording: int, stand: dict[str, Any] | None) -> Any:
        view = looked_at(desk, stand)
        if view is None:
            raise PreventUpdate
        return joints.recording_buttons(view, recording)

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
