"""Measured and predicted torque over time, and the residual beneath with what is laid over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.figures.extremes import extremes
from robot_ident.figures.models import MEASURED, NOISE, plain
from robot_ident.motion import Array, Mask
from robot_ident.workbench.brush import Condition
from robot_ident.workbench.pictures.look import BRUSH, MODEL, OVERLAYS, Shade, dressed
from robot_ident.workbench.view import Overlay, View


def over_time(
    view: View,
    joint: int,
    recording: int,
    overlays: Sequence[Overlay],
    inside: Sequence[Mask] | None,
    conditions: Sequence[Condition],
    shade: Shade,
) -> Any:
    """Return the figure; inside [N]: which rows of every recording are brushed, None where nothing is."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    rows, unit = view.rows[recording], view.unit(joint)
    counts = rows.weight[:, joint] > 0
    residual = np.where(counts, view.residual[recording][:, joint], np.nan)
    kept = np.union1d(extremes(residual), extremes(rows.measured[:, joint]))
    t = rows.t[kept]
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.42, 0.58])

    def line(y: Array, name: str, colour: str, row: int, width: float = 1.4, dash: str | None = None) -> None:
        style = {"color": colour, "width": width, "dash": dash}
        hover = "%{y:.4g} " + unit
        figure.add_trace(
            go.Scatter(x=t, y=y[kept], name=name, mode="lines", line=style, hovertemplate=hover), row=row, col=1
        )

    line(rows.measured[:, joint], "measured", MEASURED, 1, 1.0)
    line(view.predicted[recording][:, joint], "predicted", MODEL, 1, 1.4, "dash")
    line(residual, "residual", MODEL, 2)
    _noise_band(figure, view, recording, joint)
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        line(
            np.where(counts, one.residual[recording][:, joint], np.nan), f"residual {plain(one.words)}", colour, 2, 1.6
        )
    if inside is not None:
        chosen = inside[recording]
        style = {"color": BRUSH, "size": 5}
        name = "brushed"
        figure.add_trace(
            go.Scatter(x=rows.t[chosen], y=residual[chosen], name=name, mode="markers", marker=style, hoverinfo="skip"),
            row=2,
            col=1,
        )
    for span in conditions:
        if span.variable == "time" and span.recording in (None, recording):
            figure.add_vrect(span.lower, span.upper, fillcolor=BRUSH, opacity=0.12, line_width=0, row="all")
    figure.update_yaxes(title_text=f"torque, {unit}", row=1, col=1)
    figure.update_yaxes(title_text=f"residual, {unit}", row=2, col=1)
    figure.update_xaxes(
        title_text="time in the period, s" if view.recordings[recording]["periods"] > 1 else "time, s", row=2, col=1
    )
    revision = f"{view.session.name}-{joint}-{recording}"
    return dressed(figure, shade, revision, hovermode="x", dragmode="select")


def _noise_band(figure: Any, view: View, recording: int, joint: int) -> None:
    """Shade where 95 % of the residual lies when it is noise alone."""
    variance = view.recordings[recording]["noise_variance"][joint]
    if variance is not None:
        edge = 1.96 * float(np.sqrt(variance))
        figure.add_hrect(-edge, edge, fillcolor=NOISE, line_width=0, layer="below", row=2, col=1)
