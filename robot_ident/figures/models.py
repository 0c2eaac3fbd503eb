"""How models, measurement and noise are told apart in every figure."""

from __future__ import annotations

from html import escape

from robot_ident.figures.theme import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILLION

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
