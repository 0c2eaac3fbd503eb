"""Where one stands in the loop, the next step, and what is being computed."""

from __future__ import annotations

from typing import Any

from dash import html

from robot_ident.workbench.jobs import Job
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


def job(found: Job) -> list[Any]:
    """Return how the task under way stands; nothing when there is none."""
    if found.state == "running":
        words = f"{found.words[:1].upper()}{found.words[1:]}, {found.seconds:.0f} s"
        return [
            html.Progress(value=str(round(100 * found.share)), max="100", **_named(words)),
            html.Span(words),
            action("Cancel", "cancel"),
        ]
    if found.state == "failed":
        out: list[Any] = [html.P(found.words, className="wrong")]
        if found.trace:
            out.append(html.Details([html.Summary("This is a fault of the program; details"), html.Pre(found.trace)]))
        return out
    if found.state == "cancelled" or found.words:
        return [html.P(found.words)]
    return []


def _current(yes: bool) -> dict[str, Any]:
    return {"aria-current": "step"} if yes else {}


def _named(words: str) -> dict[str, Any]:
    """Return how a bar tells a screen reader what it shows."""
    return {"aria-label": words}
