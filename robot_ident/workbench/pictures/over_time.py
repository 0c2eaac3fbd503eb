"""Measured and predicted torque over time, and the residual beneath with what is laid over it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.figures.theme import MEASURED, NOISE, extremes, plain
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.brush import Condition
from robot_ident.workbench.pictures.look import (
    BRUSH,
    MODEL,
    OVERLAYS,
    Shade,
    Trace,
    band,
    brushed_band,
    curve,
    picture,
)
from robot_ident.workbench.view import Overlay, View

_UPPER, _LOWER = (0.6, 1.0), (0.0, 0.54)  # of the height: torque above, residual below
_PLACES: dict[str, dict[str, str]] = {"torque": {}, "residual": {"xaxis": "x2", "yaxis": "y2"}}


def over_time(
    view: View,
    joint: int,
    recording: int,
    overlays: Sequence[Overlay],
    inside: Sequence[Mask] | None,
    conditions: Sequence[Condition],
    shade: Shade,
) -> dict[str, Any]:
    """Return the picture; inside [N]: which rows of every recording are brushed, None where nothing is."""
    rows, unit = view.rows[recording], view.unit(joint)
    counts = rows.weight[:, joint] > 0
    measured, residual = rows.measured[:, joint], np.where(counts, view.residual[recording][:, joint], np.nan)
    kept = np.union1d(extremes(residual), extremes(measured))

    def line(y: Array, name: str, colour: str, place: str, width: float = 1.4, dash: str = "solid") -> Trace:
        style = {"color": colour, "width": width, "dash": dash}
        hover = "%{y:.4g} " + unit
        return curve(rows.t[kept], y[kept], name, mode="lines", line=style, hovertemplate=hover, **_PLACES[place])

    traces = [
        line(measured, "measured", MEASURED, "torque", 2.0),
        line(view.predicted[recording][:, joint], "predicted", MODEL[shade], "torque", 1.4, "dash"),
        line(residual, "residual", MODEL[shade], "residual"),
    ]
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        later = np.where(counts, one.residual[recording][:, joint], np.nan)
        traces.append(line(later, f"residual {plain(one.words)}", colour, "residual", 1.6))
    if inside is not None:
        chosen = inside[recording]
        style = {"color": BRUSH, "size": 5}
        more = {"mode": "markers", "marker": style, "hoverinfo": "skip", **_PLACES["residual"]}
        traces.append(curve(rows.t[chosen], residual[chosen], "brushed", **more))
    spans = [one for one in conditions if one.variable == "time" and one.recording in (None, recording)]
    shapes = [*_noise(view, recording, joint), *(brushed_band(one.lower, one.upper, "x") for one in spans)]
    along = "time in the period, s" if view.recordings[recording]["periods"] > 1 else "time, s"
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"anchor": "y", "matches": "x2", "showticklabels": False},
        "yaxis": {"domain": _UPPER, "title": f"torque, {unit}"},
        "xaxis2": {"anchor": "y2", "title": along},
        "yaxis2": {"anchor": "x2", "domain": _LOWER, "title": f"residual, {unit}"},
    }
    revision = f"{view.session.name}-{joint}-{recording}"
    return picture(traces, axes, shade, revision, shapes=shapes, hovermode="x", dragmode="select")


def _noise(view: View, recording: int, joint: int) -> list[dict[str, Any]]:
    """Shade where 95 % of the residual lies when it is noise alone."""
    variance = view.recordings[recording]["noise_variance"][joint]
    if variance is None:
        return []
    edge = 1.96 * float(np.sqrt(variance))
    return [band(-edge, edge, "y2", fillcolor=NOISE, layer="below")]
