"""The residual line by line: what the motion excites, everything else, and the floor of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from robot_ident.figures.models import plain
from robot_ident.motion import Array
from robot_ident.workbench.pictures.look import MODEL, OVERLAYS, Shade, dressed, ink
from robot_ident.workbench.view import Overlay, View

HIGHEST = 30.0  # Hz drawn: above it drives move no arm


def spectrum(view: View, joint: int, recording: int, overlays: Sequence[Overlay], shade: Shade) -> Any:
    """Return the amplitudes of the residual's Fourier lines of one recording, logarithmic."""
    import plotly.graph_objects as go

    about, unit = view.recordings[recording], view.unit(joint)
    dt, samples = float(about["dt"]), len(view.rows[recording].t)
    frequency = np.fft.rfftfreq(samples, dt)
    drawn = (frequency > 0) & (frequency <= HIGHEST)
    figure = go.Figure()

    def stems(residual: Array, rows: np.ndarray, name: str, colour: str, symbol: str) -> None:
        amplitude = np.abs(np.fft.rfft(residual)) * (2.0 / samples)
        style = {"color": colour, "size": 5, "symbol": symbol, "opacity": 0.8}
        hover = "%{x:.3g} Hz: %{y:.3g} " + unit
        figure.add_trace(
            go.Scatter(
                x=frequency[rows], y=amplitude[rows], name=name, mode="markers", marker=style, hovertemplate=hover
            )
        )

    residual = view.residual[recording][:, joint]
    lines = np.zeros(len(frequency), dtype=bool)
    if about["lines"] is not None:
        held = np.array(about["lines"], dtype=bool)[:, joint][: len(lines)]
        lines[: len(held)] = held
        stems(residual, drawn & lines, "residual, lines of the motion", MODEL, "circle")
    stems(residual, drawn & ~lines, "residual, other lines" if lines.any() else "residual", MODEL, "circle-open")
    for colour, one in zip(OVERLAYS, overlays, strict=False):
        stems(one.residual[recording][:, joint], drawn, plain(one.words), colour, "x-thin-open")
    variance = about["noise_variance"][joint]
    if variance is not None:
        # E |A|^2 = 4 s^2 / N of the amplitude of a line of white noise
        level = float(np.sqrt(4.0 * variance / samples))
        # plotly takes the height of a note on a logarithmic axis as an exponent, that of a line as a value
        note = {
            "text": "noise",
            "showarrow": False,
            "x": 1.0,
            "xref": "x domain",
            "y": np.log10(level),
            "yanchor": "bottom",
        }
        figure.add_hline(level, line_color=ink(shade), line_dash="dot", line_width=1)
        figure.add_annotation(**note)
    figure.update_yaxes(type="log", title_text=f"amplitude, {unit}")
    figure.update_xaxes(title_text="frequency, Hz")
    return dressed(figure, shade, f"{view.session.name}-{joint}-{recording}", dragmode="zoom")
