"""One look for all figures: colours that colour-blind readers tell apart, on a light or a dark page."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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


def recoloured(shade: str, axes: list[str]) -> dict[str, Any]:
    """Return the layout that turns a figure with such axes light or dark, as plotly's relayout takes it."""
    tone = SHADES[shade]
    out: dict[str, Any] = {"font.color": tone["text"], "hoverlabel.bgcolor": tone["hover"]}
    out["hoverlabel.font.color"] = tone["text"]
    for axis in axes:
        out |= {f"{axis}.gridcolor": tone["grid"], f"{axis}.linecolor": tone["axis"], f"{axis}.tickcolor": tone["axis"]}
    return out
