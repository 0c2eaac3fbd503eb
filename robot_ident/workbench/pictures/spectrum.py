"""The residual line by line: what the motion excites, everything else, and the floor of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.figures.theme import extremes_along, plain
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.pictures.look import MODEL, OVERLAYS, Shade, Trace, curve, ink, picture
from robot_ident.workbench.view import Overlay, View

MOST = 500  # markers of a kind


def spectrum(view: View, joint: int, recording: int, overlays: Sequence[Overlay], shade: Shade) -> dict[str, Any]:
    """Return the residual of one recording in every line of frequency, as the report draws it."""
    found, unit = view.lines[recording], view.unit(joint)

    def points(lines: Sequence[Array], rows: Mask, name: str, colour: str, symbol: str, size: int) -> Trace:
        x, y = found.frequency[rows], lines[recording][rows, joint]
        kept = extremes_along(x, y, MOST)
        style = {"color": colour, "size": size, "symbol": symbol}
        hover = "%{x:.3g} Hz: %{y:.3g} " + unit
        return curve(x[kept], y[kept], name, mode="markers", marker=style, hovertemplate=hover)

    traces, mine = [], view.residual_lines
    if found.excited.any():
        traces.append(points(mine, found.excited, "residual, lines of the motion", MODEL[shade], "diamond", 8))
    other = "residual, other lines" if found.excited.any() else "residual"
    traces.append(points(mine, ~found.excited, other, MODEL[shade], "circle-open", 4))
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        every = np.ones(len(found.frequency), dtype=bool)
        traces.append(points(one.lines, every, plain(one.words), colour, "x-thin-open", 5))
    if np.all(np.isfinite(found.noise[:, joint])):
        style = {"color": ink(shade), "dash": "dot", "width": 1.5}
        hover = "%{y:.3g} " + unit
        noise = found.noise[:, joint]
        traces.append(curve(found.frequency, noise, "noise", mode="lines", line=style, hovertemplate=hover))
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"type": "log", "dtick": "D2", "title": "frequency, Hz"},
        "yaxis": {"type": "log", "title": f"{unit} rms a line", "dtick": "D2"},
    }
    return picture(traces, axes, shade, f"{view.session.name}-{joint}-{recording}", dragmode="zoom")
