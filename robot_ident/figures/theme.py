"""One look for all figures: colours that colour-blind readers tell apart, on a light or a dark page; how models,
measurement and noise are told apart; long curves in fewer points with every extreme kept; no figure leaves this
machine.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


# Okabe and Ito (2008), without black and yellow: each is legible on white and on near-black.
BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
GREY = "#808890"
COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, GREY)
DASHES = ("solid", "dash", "dot", "dashdot")
FORBIDDEN = "rgba(213, 94, 0, 0.30)"
PARTLY_FORBIDDEN = "rgba(213, 94, 0, 0.10)"
FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Noto Sans', 'DejaVu Sans', sans-serif"

# What changes between a light and a dark page: text, lines of the grid, lines of the axes. The backgrounds are clear.
SHADES = {
    "light": {"text": "#1f2328", "grid": "#e3e6ea", "axis": "#8c959f", "hover": "#ffffff"},
    "dark": {"text": "#dfe3e8", "grid": "#30363d", "axis": "#7d8590", "hover": "#1c2128"},
}


def colour(index: int) -> str:
    """Return the colour of the k-th joint (or other member of a row)."""
    return COLOURS[index % len(COLOURS)]


def dash(index: int) -> str:
    """Return the line of the k-th joint; from the eighth on it differs, as colours repeat."""
    return DASHES[(index // len(COLOURS)) % len(DASHES)]


def page_look(shade: str) -> dict[str, Any]:
    """Return the layout that all figures share, on a light or a dark page."""
    tone = SHADES[shade]
    clear = "rgba(0,0,0,0)"
    return {
        "template": "none",
        "autosize": True,
        "paper_bgcolor": clear,
        "plot_bgcolor": clear,
        "font": {"family": FONT, "size": 13, "color": tone["text"]},
        "hoverlabel": {"bgcolor": tone["hover"], "font": {"family": FONT, "color": tone["text"]}},
        "margin": {"l": 64, "r": 16, "t": 28, "b": 52},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.0, "xanchor": "left", "x": 0.0},
    }


def axis_look(shade: str) -> dict[str, Any]:
    """Return what all axes share."""
    tone = SHADES[shade]
    return {
        "gridcolor": tone["grid"],
        "linecolor": tone["axis"],
        "tickcolor": tone["axis"],
        "zeroline": False,
        "showline": True,
        "ticks": "outside",
        "automargin": True,
        "title": {"standoff": 8},
    }


def themed(figure: Figure, *, height: int, **layout: Any) -> Figure:
    """Return the figure in the common look; `layout` goes to plotly's layout."""
    figure.update_layout(height=height, **page_look("light"))
    axis = axis_look("light")
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_annotations(font={"color": SHADES["light"]["text"]})
    figure.update_layout(**layout)
    return figure


def trace(label: str, shown: bool, hover: str, **look: Any) -> dict[str, Any]:
    """Return a trace; all of one label share an entry of the legend. hover: what is said of a point."""
    hover = f"{hover}<extra>{label}</extra>"
    legend = {"name": label, "legendgroup": label, "showlegend": shown, "hovertemplate": hover}
    return {"type": "scatter", **legend, **look}


def add_level(figure: Figure, span: list[float], value: float, name: str, shade: str, dashes: str) -> None:
    """Add a horizontal line, with its value in the legend."""
    line = {"color": shade, "dash": dashes, "width": 2}
    figure.add_scatter(x=span, y=[value, value], mode="lines", line=line, name=f"{name}: {value:.2f}")


def recoloured(shade: str, axes: list[str]) -> dict[str, Any]:
    """Return the layout that turns a figure with such axes light or dark, as plotly's relayout takes it."""
    tone = SHADES[shade]
    out: dict[str, Any] = {"font.color": tone["text"], "hoverlabel.bgcolor": tone["hover"]}
    out["hoverlabel.font.color"] = tone["text"]
    for axis in axes:
        out |= {f"{axis}.gridcolor": tone["grid"], f"{axis}.linecolor": tone["axis"], f"{axis}.tickcolor": tone["axis"]}
    return out


MEASURED = GREY
NOISE = "rgba(128, 136, 144, 0.28)"
"""The band that noise alone fills."""

NOISE_LINE = GREY
_EARLIER = (VERMILLION, ORANGE, PURPLE, GREEN, SKY)


def model_colour(place: int, count: int) -> str:
    """Return the colour of a model among several in their order: the last one is blue, wherever it is shown."""
    return BLUE if place == count - 1 else _EARLIER[place % len(_EARLIER)]


def plain(text: str) -> str:
    """Return a user's text as plotly shows it letter by letter, no part of it taken for mark-up."""
    return escape(text, quote=False).replace("%{", "% {")


POINTS = 2000
"""Points of a curve at most; about as many as a page is wide in pixels."""


def extremes(y: Array, points: int = POINTS) -> NDArray[np.int64]:
    """Return which rows of a curve y [N] to draw: all where there are few, else the smallest and the largest of every
    one of `points / 2` stretches of equal length, in their order.

    No peak is lost and none is made. A stretch with nothing finite gives one of its rows, so that a gap stays a gap.
    """
    if len(y) <= points:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), points // 2 + 1).astype(np.int64)
    low = np.where(np.isfinite(y), y, np.inf)
    high = np.where(np.isfinite(y), y, -np.inf)
    chosen = []
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        chosen += sorted({int(a + np.argmin(low[a:b])), int(a + np.argmax(high[a:b]))})
    return np.array(chosen, dtype=np.int64)


def extremes_along(x: Array, y: Array, points: int = POINTS) -> NDArray[np.int64]:
    """Return which rows of a cloud (x, y) [N] to draw: smallest and largest y of every one of `points / 2` stretches
    of x that hold equally many, in the order of x.
    """
    order = np.argsort(x, kind="stable")
    return order[extremes(y[order], points)]


def private(*removed: str, **more: Any) -> dict[str, Any]:
    """Return plotly's configuration without the buttons that upload a figure, and without those that are named."""
    return {
        "displaylogo": False,
        "showSendToCloud": False,
        "showEditInChartStudio": False,
        "plotlyServerURL": "",
        "modeBarButtonsToRemove": ["sendChartToCloud", "sendDataToCloud", "editInChartStudio", *removed],
        **more,
    }
