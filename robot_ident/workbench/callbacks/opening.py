"""Begins a session on the recordings that were chosen."""

from __future__ import annotations

from typing import Any

from dash import ALL, Dash, Input, Output, State, no_update
from dash.exceptions import PreventUpdate

from robot_ident.errors import InputError
from robot_ident.workbench.desk import Desk


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the first page."""

    @app.callback(
        Output("address", "pathname"),
        Output("refused", "children"),
        Input("begin", "n_clicks"),
        State({"role": ALL}, "value"),
        State({"role": ALL}, "id"),
        State("brought", "value"),
        State("robot", "value"),
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
