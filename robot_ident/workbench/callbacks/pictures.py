"""Draws the pictures whenever what they show changes."""

from __future__ import annotations

from typing import Any

from dash import Dash, Input, Output, State
from dash.exceptions import PreventUpdate

from robot_ident.signals.motion import Mask
from robot_ident.workbench.brush import Condition, brushed
from robot_ident.workbench.callbacks.looked import looked_at
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.pictures.look import Shade
from robot_ident.workbench.pictures.over_time import over_time
from robot_ident.workbench.pictures.scatter import scatter
from robot_ident.workbench.pictures.spectrum import spectrum
from robot_ident.workbench.pictures.staircase import staircase
from robot_ident.workbench.pictures.told import over_time_told, scatter_told, spectrum_told, staircase_told
from robot_ident.workbench.view import View

_CHANGES = (Input("drawn", "data"), Input("joint", "data"), Input("overlays", "data"), Input("shade", "data"))
_STAND = State("stand", "data")


def register(app: Dash, desk: Desk) -> None:
    """Register the callbacks of the pictures."""

    def shown(stand: dict[str, Any] | None, joint: int | None, shade: Shade | None) -> tuple[View, int]:
        view = looked_at(desk, stand)
        if view is None or shade is None:
            raise PreventUpdate
        return view, view.focus if joint is None else joint

    @app.callback(*_outputs("time"), *_CHANGES, Input("recording", "data"), Input("brush", "data"), _STAND)
    def time(
        _drawn: str,
        joint: int | None,
        keys: list[str],
        shade: Shade,
        recording: int,
        brush: list[Any],
        stand: dict[str, Any],
    ) -> Any:
        view, place = shown(stand, joint, shade)
        conditions, inside = _brushed(view, place, brush)
        figure = over_time(view, place, recording, view.overlays(keys), inside, conditions, shade)
        return figure, over_time_told(view, place, recording)

    @app.callback(*_outputs("scatter"), *_CHANGES, Input("over", "value"), Input("brush", "data"), _STAND)
    def clouds(
        _drawn: str,
        joint: int | None,
        keys: list[str],
        shade: Shade,
        over: str,
        brush: list[Any],
        stand: dict[str, Any],
    ) -> Any:
        view, place = shown(stand, joint, shade)
        conditions, inside = _brushed(view, place, brush)
        variables = ("velocity", "position", over)
        figure = scatter(view, place, variables, view.overlays(keys), inside, conditions, shade)
        return figure, scatter_told(view, place)

    @app.callback(*_outputs("spectrum"), *_CHANGES, Input("recording", "data"), _STAND)
    def lines(
        _drawn: str, joint: int | None, keys: list[str], shade: Shade, recording: int, stand: dict[str, Any]
    ) -> Any:
        view, place = shown(stand, joint, shade)
        return spectrum(view, place, recording, view.overlays(keys), shade), spectrum_told(view, place, recording)

    @app.callback(*_outputs("staircase"), *_CHANGES, _STAND)
    def stairs(_drawn: str, joint: int | None, keys: list[str], shade: Shade, stand: dict[str, Any]) -> Any:
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
