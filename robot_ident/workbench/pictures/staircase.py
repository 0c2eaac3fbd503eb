"""The error of a joint from step to step, on training and on validation, beside the floor of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.figures.models import plain
from robot_ident.figures.theme import BLUE, VERMILLION
from robot_ident.workbench.pictures.look import Shade, dressed
from robot_ident.workbench.view import CANDIDATE, Overlay, View


@dataclass(frozen=True)
class _Kind:
    """A line: its errors and its noise by name, its look, and where its figures stand."""

    errors: str
    noise: str
    colour: str
    symbol: str
    above: bool


_KINDS = (
    _Kind("training", "noise", BLUE, "circle", False),
    _Kind("validation", "validation_noise", VERMILLION, "square", True),
)


_HEADROOM = 1.25  # of the highest error: its figure stands above it, below the legend


def staircase(view: View, joint: int, overlays: Sequence[Overlay], shade: Shade) -> Any:
    """Return the root mean squares along the path of steps, and what candidates would make of them (hollow)."""
    import plotly.graph_objects as go

    name, unit = view.joints[joint], view.unit(joint)
    path = view.session.path(view.number)
    errors = [View(view.session, number).errors for number in path]
    ahead = [one for one in overlays if one.key.startswith(CANDIDATE)]
    ticks = [*(_words(view, number) for number in path), *(_broken(one.words) for one in ahead)]
    figure = go.Figure()
    for kind in _KINDS:
        if errors[-1][kind.errors] is None:
            continue
        done = [_rms(one[kind.errors], name) for one in errors]
        figure.add_trace(_trace(kind, list(range(len(path))), done, kind.errors, hollow=False))
        foreseen = [_rms(getattr(one, kind.errors), name) for one in ahead]
        if foreseen:
            places = [len(path) + k for k in range(len(ahead))]
            figure.add_trace(_trace(kind, places, foreseen, f"{kind.errors}, predicted", hollow=True))
        noise = errors[-1][kind.noise][name]
        if noise is not None:
            level, ends = float(np.sqrt(noise)), [-0.4, len(ticks) - 0.6]
            style = {"color": kind.colour, "dash": "dot", "width": 1.5}
            trace = go.Scatter(
                x=ends, y=[level, level], mode="lines", line=style, name="noise", hovertemplate="%{y:.4g}"
            )
            figure.add_trace(trace.update(showlegend=not kind.above))
    drawn = [one for trace in figure.data for one in trace.y]
    highest = max((one for one in drawn if np.isfinite(one)), default=1.0)
    figure.update_xaxes(tickvals=list(range(len(ticks))), ticktext=ticks, range=[-0.4, len(ticks) - 0.6], tickangle=0)
    figure.update_yaxes(title_text=f"{plain(name)}, {unit} rms", range=[0.0, _HEADROOM * highest])
    return dressed(figure, shade, f"{view.session.name}-{view.number}-{joint}-{len(ahead)}", dragmode=False)


def _trace(kind: _Kind, x: list[int], y: list[float], name: str, *, hollow: bool) -> Any:
    import plotly.graph_objects as go

    symbol = f"{kind.symbol}-open" if hollow else kind.symbol
    return go.Scatter(
        x=x,
        y=y,
        name=name,
        mode="markers+text" if hollow else "lines+markers+text",
        line={"color": kind.colour, "width": 2, "shape": "hv"},
        marker={"size": 9, "symbol": symbol, "color": kind.colour, "line": {"width": 2, "color": kind.colour}},
        text=[f"{value:.3g}" for value in y],
        textposition="top center" if kind.above else "middle right",
        cliponaxis=False,
        showlegend=not hollow,
        hovertemplate="%{y:.4g}",
    )


def _words(view: View, number: int) -> str:
    added = view.session.steps[number].added
    return _broken(f"+ {added}") if added else f"step {number}:<br>to begin with"


def _broken(text: str) -> str:
    """Return a name in short lines."""
    return plain(text).replace("with ", "with<br>").replace("@", "<br>@")


def _rms(errors: Mapping[str, Any], joint: str) -> float:
    return float(np.sqrt(errors[joint]))
