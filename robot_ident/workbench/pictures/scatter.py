"""The residual of the training recordings over what it may depend on, all pictures of the same moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.figures.residual_scatter import Binned, binned
from robot_ident.figures.theme import extremes, plain
from robot_ident.signals.motion import Array, Mask
from robot_ident.workbench.brush import Condition, values
from robot_ident.workbench.pictures.look import BRUSH, MODEL, OVERLAYS, Shade, Trace, brushed_band, curve, picture
from robot_ident.workbench.symbols import symbol_of
from robot_ident.workbench.view import Overlay, View

MOST = 600  # points of a panel, all recordings together; a browser takes most of its time for them
_BINS = 24
_GAP = 0.025  # of the width, between panels
_FAINT: dict[Shade, float] = {"light": 0.25, "dark": 0.4}  # opacity: points vanish in the dark sooner
_SIDES = ((1, "forward", "solid", "triangle-right"), (-1, "backward", "dot", "triangle-left"))


@dataclass(frozen=True)
class _Shown:
    """A joint of the training recordings: its residual, which rows count, and which of them are drawn."""

    view: View
    joint: int
    residual: list[Array]
    used: list[Mask]
    drawn: list[Mask]

    @classmethod
    def of(cls, view: View, joint: int) -> _Shown:
        residual = [view.residual[k][:, joint] for k in view.training]
        used = [view.rows[k].weight[:, joint] > 0 for k in view.training]
        most = MOST // len(residual)
        return cls(view, joint, residual, used, [_thinned(r, u, most) for r, u in zip(residual, used, strict=True)])

    def along(self, variable: str) -> list[Array]:
        """Return a variable along every recording."""
        view = self.view
        return [values(view.rows[k], variable, view.loads[k], view.joints, self.joint) for k in view.training]

    def means(self, x: Sequence[Array], residual: Sequence[Array], side: int) -> Binned:
        """Return the mean residual over a variable, of one direction of the joint's motion."""
        speeds = [self.view.rows[k].dq[:, self.joint] for k in self.view.training]
        used = [u & (speed * side > 0.0) for u, speed in zip(self.used, speeds, strict=True)]
        return binned(list(x), list(residual), used, [float("nan")] * len(used), _BINS)


def scatter(
    view: View,
    joint: int,
    variables: Sequence[str],
    overlays: Sequence[Overlay],
    inside: Sequence[Mask] | None,
    conditions: Sequence[Condition],
    shade: Shade,
) -> dict[str, Any]:
    """Return the picture, a panel a variable: the residual as points, its means by direction of motion as lines.

    Of what is laid over it the means alone. inside [N]: which rows of every recording are brushed, or None.
    """
    shown = _Shown.of(view, joint)
    later = [[one.residual[k][:, joint] for k in view.training] for one in overlays]
    traces: list[Trace] = []
    shapes: list[dict[str, Any]] = []
    axes: dict[str, dict[str, Any]] = {}
    width = (1.0 - _GAP * (len(variables) - 1)) / len(variables)
    for column, name in enumerate(variables, 1):
        place = _place(column)
        x = shown.along(name)
        traces.append(_cloud(place, x, shown.residual, shown.drawn, MODEL[shade], "residual", _FAINT[shade], 3.0))
        if inside is not None:
            chosen = [d & inside[k] for d, k in zip(shown.drawn, view.training, strict=True)]
            traces.append(_cloud(place, x, shown.residual, chosen, BRUSH, "brushed", 0.9, 4.5))
        traces += _lines(place, shown, x, shown.residual, MODEL[shade], "mean")
        for colour, one, residual in zip(OVERLAYS, overlays, later, strict=False):
            traces += _lines(place, shown, x, residual, colour, f"mean {plain(one.words)}")
        named = (name, f"{name} of {view.joints[joint]}")
        shapes += [brushed_band(one.lower, one.upper, place["xaxis"]) for one in conditions if one.variable in named]
        symbol, unit = symbol_of(view, joint, name)
        number, start = place["xaxis"][1:], (column - 1) * (width + _GAP)
        axes[f"xaxis{number}"] = {
            "anchor": place["yaxis"],
            "domain": (start, start + width),
            "title": f"{symbol}, {unit}",
        }
        axes[f"yaxis{number}"] = {"anchor": place["xaxis"], "matches": "y", "showticklabels": column == 1}
    axes["yaxis"] = {"anchor": "x", "title": f"residual, {view.unit(joint)}"}
    revision = f"{view.session.name}-{joint}-{','.join(variables)}"
    return picture(traces, axes, shade, revision, shapes=shapes, dragmode="select", hovermode="closest")


def _place(column: int) -> dict[str, str]:
    """Return the axes of a panel, counted from one."""
    number = "" if column == 1 else str(column)
    return {"xaxis": f"x{number}", "yaxis": f"y{number}"}


def _thinned(residual: Array, used: Mask, most: int) -> Mask:
    """Return which rows are drawn: some at even distances, as they are spread, and the extremes."""
    drawn = np.zeros(len(residual), dtype=bool)
    drawn[:: max(1, 2 * len(residual) // most)] = True
    drawn[extremes(np.where(used, residual, np.nan), max(2, most // 4))] = True
    return drawn & used


def _cloud(
    place: dict[str, str],
    x: Sequence[Array],
    y: Sequence[Array],
    rows: Sequence[Mask],
    colour: str,
    name: str,
    opacity: float,
    size: float,
) -> Trace:
    return curve(
        np.concatenate([one[chosen] for one, chosen in zip(x, rows, strict=True)]),
        np.concatenate([one[chosen] for one, chosen in zip(y, rows, strict=True)]),
        name,
        legendgroup=name,
        showlegend=place["xaxis"] == "x",
        mode="markers",
        marker={"color": colour, "size": size, "opacity": opacity},
        hovertemplate="%{x:.4g}, %{y:.4g}",
        **place,
    )


def _lines(
    place: dict[str, str], shown: _Shown, x: Sequence[Array], residual: Sequence[Array], colour: str, name: str
) -> list[Trace]:
    """Return the means of either direction of motion."""
    out = []
    for side, words, dash, symbol in _SIDES:
        found = shown.means(x, residual, side)
        trace = curve(
            found.middle,
            found.mean,
            f"{name}, {words}",
            legendgroup=f"{name}, {words}",
            showlegend=place["xaxis"] == "x" and (colour in MODEL.values() or side > 0),
            mode="lines+markers",
            line={"color": colour, "dash": dash, "width": 2},
            marker={"symbol": symbol, "size": 6},
            hovertemplate="%{x:.4g}: %{y:.3g}",
            **place,
        )
        out.append(trace)
    return out
