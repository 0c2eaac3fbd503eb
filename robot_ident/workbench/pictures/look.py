"""What the pictures share: the common theme, light or dark, which colour means what, and how arrays are sent.

A picture is the plain dictionary that plotly.js draws. Building it from plotly's Python classes, which check every
value, would take most of the time between a click and the picture.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from robot_ident.figures.theme import BLUE, GREEN, ORANGE, PURPLE, SHADES, SKY, axis_look, page_look
from robot_ident.signals.motion import Array

Shade = Literal["light", "dark"]
Trace = dict[str, Any]

MODEL: dict[Shade, str] = {"light": BLUE, "dark": SKY}
"""Of the present step; the blue that reads on white is dim on black."""

BRUSH = PURPLE
OVERLAYS = (ORANGE, GREEN)
"""Of what is laid over the residual, in the order in which it was ticked."""


def ink(shade: Shade) -> str:
    """Return the colour of measurements and of the noise's floor."""
    return SHADES[shade]["text"]


def packed(values: Array) -> dict[str, str]:
    """Return numbers [N] as plotly.js takes them in binary: four bytes each, nan a gap."""
    return {"dtype": "f4", "bdata": base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode()}


def curve(x: Array, y: Array, name: str, **more: Any) -> Trace:
    """Return a trace over two arrays [N]."""
    return {"type": "scatter", "x": packed(x), "y": packed(y), "name": name, **more}


def band(lower: float, upper: float, axis: str, **more: Any) -> dict[str, Any]:
    """Return a shape that shades all between two values of an axis like `x2` or `y`."""
    along = axis[0]
    across = "y" if along == "x" else "x"
    ends = {f"{along}0": lower, f"{along}1": upper, f"{across}0": 0.0, f"{across}1": 1.0}
    return {"type": "rect", f"{along}ref": axis, f"{across}ref": "paper", "line": {"width": 0}, **ends, **more}


def brushed_band(lower: float, upper: float, axis: str) -> dict[str, Any]:
    """Return the shape of a brushed region."""
    return band(lower, upper, axis, fillcolor=BRUSH, opacity=0.12)


def picture(
    traces: Sequence[Trace],
    axes: Mapping[str, Mapping[str, Any]],
    shade: Shade,
    revision: str,
    *,
    shapes: Sequence[Mapping[str, Any]] = (),
    **layout: Any,
) -> dict[str, Any]:
    """Return the picture in the page's look, as high as its place on the page.

    axes: by their name in plotly's layout; a title given as text. revision: as long as it stays, a reader's zoom is
    kept.
    """
    common = {**axis_look(shade), "automargin": False}
    dressed = {
        name: {**common, **axis, "title": {**common["title"], "text": axis.get("title", "")}}
        for name, axis in axes.items()
    }
    look: dict[str, Any] = {
        **page_look(shade),
        **dressed,
        "shapes": list(shapes),
        "uirevision": revision,
        "selectdirection": "h",
        "newselection": {"line": {"color": BRUSH, "width": 1}},
        **layout,
    }
    look["legend"] = {**look["legend"], "itemsizing": "constant"}  # points of a cloud could not be seen there
    return {"data": list(traces), "layout": look}
