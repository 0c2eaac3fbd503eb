"""The residual of the training recordings over what it may depend on, all pictures of the same moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.figures.binned import Binned, binned
from robot_ident.figures.extremes import extremes
from robot_ident.figures.models import plain
from robot_ident.motion import Array, Mask
from robot_ident.workbench.brush import Condition, values
from robot_ident.workbench.pictures.look import BRUSH, MODEL, OVERLAYS, Shade, dressed
from robot_ident.workbench.symbols import symbol_of
from robot_ident.workbench.view import Overlay, View

MOST = 900  # points of a picture, all recordings together
_BINS = 24
_FAINT: dict[Shade, float] = {"light": 0.25, "dark": 0.6}  # opacity: blue points vanish in the dark sooner
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
) -> Any:
    """Return the figure, a picture a variable: the residual as points, its means by direction of motion as lines.

    Of what is laid over it the means alone. inside [N]: which rows of every recording are brushed, or None.
    """
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=1, cols=len(variables), shared_yaxes=True, horizontal_spacing=0.025)
    shown = _Shown.of(view, joint)
    later = [[one.residual[k][:, joint] for k in view.training] for one in overlays]
    for column, name in enumerate(variables, 1):
        x = shown.along(name)
        _cloud(figure, column, x, shown.residual, shown.drawn, MODEL, "residual", _FAINT[shade], 3.0)
        if inside is not None:
            chosen = [d & inside[k] for d, k in zip(shown.drawn, view.training, strict=True)]
            _cloud(figure, column, x, shown.residual, chosen, BRUSH, "brushed", 0.9, 4.5)
        _lines(figure, column, shown, x, shown.residual, MODEL, "mean")
        for colour, one, residual in zip(OVERLAYS, overlays, later, strict=False):
            _lines(figure, column, shown, x, residual, colour, f"mean {plain(one.words)}")
        for span in conditions:
            if span.variable in (name, f"{name} of {view.joints[joint]}"):
                figure.add_vrect(span.lower, span.upper, fillcolor=BRUSH, opacity=0.12, line_width=0, row=1, col=column)
        symbol, unit = symbol_of(view, joint, name)
        figure.update_xaxes(title_text=f"{symbol}, {unit}", row=1, col=column)
    figure.update_yaxes(title_text=f"residual, {view.unit(joint)}", row=1, col=1)
    revision = f"{view.session.name}-{joint}-{','.join(variables)}"
    return dressed(figure, shade, revision, dragmode="select", hovermode="closest")


def _thinned(residual: Array, used: Mask, most: int) -> Mask:
    """Return which rows are drawn: some at even distances, as they are spread, and the extremes."""
    drawn = np.zeros(len(residual), dtype=bool)
    drawn[:: max(1, 2 * len(residual) // most)] = True
    drawn[extremes(np.where(used, residual, np.nan), max(2, most // 4))] = True
    return drawn & used


def _cloud(
    figure: Any,
    column: int,
    x: Sequence[Array],
    y: Sequence[Array],
    rows: Sequence[Mask],
    colour: str,
    name: str,
    opacity: float,
    size: float,
) -> None:
    import plotly.graph_objects as go

    trace = go.Scatter(
        x=np.concatenate([one[chosen] for one, chosen in zip(x, rows, strict=True)]),
        y=np.concatenate([one[chosen] for one, chosen in zip(y, rows, strict=True)]),
        name=name,
        legendgroup=name,
        showlegend=column == 1,
        mode="markers",
        marker={"color": colour, "size": size, "opacity": opacity},
        hovertemplate="%{x:.4g}, %{y:.4g}",
    )
    figure.add_trace(trace, row=1, col=column)


def _lines(
    figure: Any, column: int, shown: _Shown, x: Sequence[Array], residual: Sequence[Array], colour: str, name: str
) -> None:
    import plotly.graph_objects as go

    for side, words, dash, symbol in _SIDES:
        found = shown.means(x, residual, side)
        trace = go.Scatter(
            x=found.middle,
            y=found.mean,
            name=f"{name}, {words}",
            legendgroup=f"{name}, {words}",
            showlegend=column == 1 and (colour == MODEL or side > 0),
            mode="lines+markers",
            line={"color": colour, "dash": dash, "width": 2},
            marker={"symbol": symbol, "size": 6},
            hovertemplate="%{x:.4g}: %{y:.3g}",
        )
        figure.add_trace(trace, row=1, col=column)
