"""What the pictures share: the common theme, light or dark, and which colour means what."""

from __future__ import annotations

from typing import Any, Literal

from robot_ident.figures.theme import BLUE, GREEN, ORANGE, PURPLE, SHADES, recoloured, themed

Shade = Literal["light", "dark"]

MODEL, BRUSH = BLUE, PURPLE
OVERLAYS = (ORANGE, GREEN)
"""Of what is laid over the residual, in the order in which it was ticked."""


def ink(shade: Shade) -> str:
    """Return the colour of measurements and of the noise's floor."""
    return SHADES[shade]["text"]


def dressed(figure: Any, shade: Shade, revision: str, **layout: Any) -> Any:
    """Give a figure the page's look; revision: as long as it stays, a reader's zoom is kept."""
    themed(figure, height=300, uirevision=revision, selectdirection="h", **layout)
    figure.update_layout(legend_itemsizing="constant")  # points as small as those of a cloud could not be seen there
    figure.layout.height = None  # as high as its place on the page
    figure.update_layout(newselection={"line": {"color": BRUSH, "width": 1}})
    axes = [name for name in figure.layout if name.startswith(("xaxis", "yaxis"))]
    tones = recoloured(shade, axes)
    figure.update_layout(**{key.replace(".", "_"): value for key, value in tones.items()})
    figure.update_annotations(font_color=SHADES[shade]["text"])
    return figure
