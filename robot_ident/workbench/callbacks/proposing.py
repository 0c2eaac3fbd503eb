"""Looks at the recordings of the first page, one by one, and proposes what each is for."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from dash import ALL, MATCH, Dash, Input, Output, State, no_update
from dash.exceptions import PreventUpdate

from robot_ident.errors import RobotIdentError
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.roles import Seen, propose


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the proposal."""

    @app.callback(
        Output({"about": MATCH, "part": "words"}, "children"),
        Output({"about": MATCH, "part": "seen"}, "data"),
        Input("robot", "value"),
        Input("brought", "value"),
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
        found = propose(seen)
        if any(role != "none" for role in roles):  # someone has chosen already
            return [no_update] * len(roles), no_update
        return [found.roles[name] for name in names], found.words
