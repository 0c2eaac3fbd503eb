"""The error of a joint from step to step, on training and on validation, beside the floor of the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.figures.theme import VERMILLION, plain
from robot_ident.report.wording import short
from robot_ident.signals.motion import Array
from robot_ident.workbench.pictures.look import MODEL, Shade, Trace, curve, picture
from robot_ident.workbench.view import CANDIDATE, Overlay, View


@dataclass(frozen=True)
class _Kind:
    """A line: its errors and its noise by name, its look, and where its figures stand."""

    errors: str
    noise: str
    colour: Mapping[Shade, str]
    symbol: str
    above: bool


_VALIDATION: dict[Shade, str] = {"light": VERMILLION, "dark": VERMILLION}
_KINDS = (
    _Kind("training", "noise", MODEL, "circle", False),
    _Kind("validation", "validation_noise", _VALIDATION, "square", True),
)


_HEADROOM = 1.25  # of the highest error: its figure stands above it, below the legend


def staircase(view: View, joint: int, overlays: Sequence[Overlay], shade: Shade) -> dict[str, Any]:
    """Return the root mean squares along the path of steps, and what candidates would make of them (hollow)."""
    name, unit = view.joints[joint], view.unit(joint)
    path = view.session.path(view.number)
    errors = [View(view.session, number).errors for number in path]
    ahead = [one for one in overlays if one.key.startswith(CANDIDATE)]
    ticks = [*(_words(view, number) for number in path), *(_broken(one.words) for one in ahead)]
    ends = (-0.4, len(ticks) - 0.6)
    traces: list[Trace] = []
    highest = 0.0
    for kind in _KINDS:
        if errors[-1][kind.errors] is None:
            continue
        done = [_rms(one[kind.errors], name) for one in errors]
        foreseen = [_rms(getattr(one, kind.errors), name) for one in ahead]
        places = np.arange(len(ticks), dtype=float)
        traces.append(_levels(kind, places[: len(path)], done, kind.errors, shade, hollow=False))
        if foreseen:
            traces.append(_levels(kind, places[len(path) :], foreseen, f"{kind.errors}, predicted", shade, hollow=True))
        noise = errors[-1][kind.noise][name]
        level = 0.0 if noise is None else float(np.sqrt(noise))
        if noise is not None:
            style = {"color": kind.colour[shade], "dash": "dot", "width": 1.5}
            line = {"mode": "lines", "line": style, "hovertemplate": "%{y:.4g}", "showlegend": not kind.above}
            traces.append(curve(np.array(ends), np.array([level, level]), "noise", **line))
        highest = max(highest, level, *done, *foreseen)
    axes: dict[str, dict[str, Any]] = {
        "xaxis": {"tickvals": list(range(len(ticks))), "ticktext": ticks, "range": ends, "tickangle": 0},
        "yaxis": {"title": f"{plain(name)}, {unit} rms", "range": (0.0, _HEADROOM * (highest or 1.0))},
    }
    revision = f"{view.session.name}-{view.number}-{joint}-{len(ahead)}"
    return picture(traces, axes, shade, revision, dragmode=False, margin={"l": 64, "r": 16, "t": 28, "b": 76})


def _levels(kind: _Kind, x: Array, y: list[float], name: str, shade: Shade, *, hollow: bool) -> Trace:
    colour = kind.colour[shade]
    symbol = f"{kind.symbol}-open" if hollow else kind.symbol
    return curve(
        x,
        np.array(y),
        name,
        mode="markers+text" if hollow else "lines+markers+text",
        line={"color": colour, "width": 2, "shape": "hv"},
        marker={"size": 9, "symbol": symbol, "color": colour, "line": {"width": 2, "color": colour}},
        text=[short(value) for value in y],
        textposition="middle left" if kind.above else "middle right",
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
