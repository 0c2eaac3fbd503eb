"""A button that does something to the session."""

from __future__ import annotations

from typing import Any

from dash import html


def action(text: str, do: str, label: str = "", at: str = "", **more: Any) -> html.Button:
    """Return a button: what it does, to which effect or step; at: tells buttons of the same deed apart."""
    return html.Button(text, id={"do": do, "label": label, "at": at}, **more)
