"""What a page does by itself, in `assets/workbench.js`: nothing of it waits for the server."""

from __future__ import annotations

from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, State


def register(app: Dash) -> None:
    """Register the callbacks that run in the browser."""

    def run(name: str, *places: Any, at_first: bool = True) -> None:
        function = ClientsideFunction("workbench", name)
        app.clientside_callback(function, *places, prevent_initial_call=not at_first)  # type: ignore[no-untyped-call]

    run("look", Output("shade", "data"), Input("look", "n_clicks"))
    for name in ("joint", "recording"):
        pressed, ids = Input({name: ALL}, "n_clicks"), Input({name: ALL}, "id")
        run("choose", Output(name, "data", allow_duplicate=True), pressed, at_first=False)
        focus = [Input("focus", "data")] if name == "joint" else []
        run("mark", Output({name: ALL}, "aria-pressed"), Input(name, "data"), ids, *focus)
    run(
        "toggle",
        Output("overlays", "data", allow_duplicate=True),
        Input({"tick": ALL}, "n_clicks"),
        State("overlays", "data"),
        at_first=False,
    )
    run("ticked", Output({"tick": ALL}, "aria-checked"), Input("overlays", "data"), Input({"tick": ALL}, "id"))
    run(
        "real",
        Output("brushing", "data"),
        Input("time", "selectedData"),
        Input("scatter", "selectedData"),
        Input({"brush": ALL}, "n_clicks"),
        Input({"drop": ALL}, "n_clicks"),
        Input({"region": ALL}, "n_clicks"),
        at_first=False,
    )
    run(
        "stood",
        Output("running", "data"),
        Output("said", "children", allow_duplicate=True),
        Input("stand", "data"),
        State("running", "data"),
        at_first=False,
    )
    run(
        "job",
        Output("work", "hidden"),
        Output("progress", "value"),
        Output("told", "children"),
        Output("told", "className"),
        Output("fault", "hidden"),
        Output("trace", "children"),
        Input("task", "data"),
    )
