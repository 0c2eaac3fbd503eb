"""The joints with their errors, and the recordings: what is looked at is chosen here."""

from __future__ import annotations

from typing import Any

from dash import html

from robot_ident.workbench.view import View


def joint_cards(view: View, chosen: int) -> list[Any]:
    """Return a card for every joint: its residual beside the noise, and whether the model fits."""
    return [_card(view, k, chosen) for k in range(len(view.joints))]


def _card(view: View, joint: int, chosen: int) -> html.Button:
    found, unit = view.comparison["joints"][joint], view.unit(joint)
    noise = found["noise_variance"]
    fails = found["fails"]
    word = "not judged" if fails is None else "does not fit" if fails else "fits"
    if joint == view.worst and fails is not False:
        word += ", worst"
    classes = ["joint", *(["chosen"] if joint == chosen else []), *(["fails"] if fails else [])]
    lines = [
        html.B(found["name"]),
        html.Span(word, className="word"),
        html.Span(f"residual {found['residual_mse'] ** 0.5:.3g} {unit} rms"),
        html.Span("noise unknown" if noise is None else f"noise {noise**0.5:.3g} {unit} rms"),
    ]
    return html.Button(lines, id={"joint": joint}, className=" ".join(classes), **_pressed(joint == chosen))


def recording_buttons(view: View, chosen: int) -> list[Any]:
    """Return a button for every recording; one is drawn over time."""
    out = []
    for place, one in enumerate(view.recordings):
        name = f"{one['name']} (validation)" if one["validation"] else str(one["name"])
        classes, notes = "chosen" if place == chosen else "", "; ".join(one["notes"])
        button = html.Button(name, id={"recording": place}, className=classes, title=notes, **_pressed(place == chosen))
        out.append(button)
    return out


def _pressed(yes: bool) -> dict[str, Any]:
    """Return how a button tells a screen reader that it is chosen."""
    return {"aria-pressed": str(yes).lower()}
