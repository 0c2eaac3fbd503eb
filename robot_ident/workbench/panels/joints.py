"""The joints with their errors, and the recordings: what is looked at is chosen here."""

from __future__ import annotations

from typing import Any

from dash import html

from robot_ident.report.wording import short
from robot_ident.workbench.view import View


def joint_cards(view: View) -> list[Any]:
    """Return a card for every joint: its residual beside the noise, and whether the model fits."""
    return [_card(view, k) for k in range(len(view.joints))]


def _card(view: View, joint: int) -> html.Button:
    found, unit = view.comparison["joints"][joint], view.unit(joint)
    noise = found["noise_variance"]
    fails, word = found["fails"], str(found["in_words"])
    if joint == view.worst and fails is not False:
        word += ", worst"
    lines = [
        html.B(found["name"]),
        html.Span(word, className="word"),
        html.Span(f"residual {short(found['residual_mse'] ** 0.5)} {unit} rms"),
        html.Span("noise unknown" if noise is None else f"noise {short(noise**0.5)} {unit} rms"),
    ]
    return html.Button(lines, id={"joint": joint}, className="joint fails" if fails else "joint", **_unpressed())


def recording_buttons(view: View) -> list[Any]:
    """Return a button for every recording; one is drawn over time."""
    out = []
    for place, one in enumerate(view.recordings):
        name = f"{one['name']} (validation)" if one["validation"] else str(one["name"])
        notes = "; ".join(one["notes"])
        out.append(html.Button(name, id={"recording": place}, title=notes, **_unpressed()))
    return out


def _unpressed() -> dict[str, Any]:
    """Return what makes a button one of which one is chosen; the page itself says which (`callbacks/client.py`)."""
    return {"aria-pressed": "false"}
