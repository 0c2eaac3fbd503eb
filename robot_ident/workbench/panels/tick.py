"""A box to tick: what is laid over the residual."""

from __future__ import annotations

from typing import Any

from dash import html


def tick(text: str, key: str, *, ticked: bool, disabled: bool = False) -> html.Button:
    """Return a box. It is a button, so that drawing it anew is never taken for a click on it."""
    state: dict[str, Any] = {"role": "checkbox", "aria-checked": str(ticked).lower()}
    return html.Button(text, id={"tick": key}, className="tick", disabled=disabled, **state)
