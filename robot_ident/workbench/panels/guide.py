"""Where one stands in the loop, and the next step."""

from __future__ import annotations

from typing import Any

from dash import html

from robot_ident.workbench.panels.action import action
from robot_ident.workbench.words import STAGES, Next


def stages(now: Next) -> list[Any]:
    """Return the loop, with the stage where one stands."""
    return [
        html.Li(
            [html.B(name), html.Span(text)],
            className="here" if name == now.stage else "",
            **_current(name == now.stage),
        )
        for name, text in STAGES.items()
    ]


def next_step(now: Next, running: bool) -> list[Any]:
    """Return the words of the next step, and its button."""
    out: list[Any] = [html.P(now.words)]
    if now.button and now.do:
        out.append(action(now.button, now.do, now.label, "next", className="primary", disabled=running))
    return out


def _current(yes: bool) -> dict[str, Any]:
    return {"aria-current": "step"} if yes else {}
