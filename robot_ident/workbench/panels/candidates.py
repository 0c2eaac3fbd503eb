"""The candidates of a diagnosis, each with the fall of the error that it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dash import dcc, html

from robot_ident.workbench.panels.action import action
from robot_ident.workbench.view import CANDIDATE, View


def candidates(view: View, overlays: Sequence[str], running: bool) -> list[Any]:
    """Return the verdict, the candidates, and a way to try any other effect."""
    found = view.diagnosis
    if found is None:
        words = "Not looked for yet."
        if not view.failing and view.judged:
            words = "The model fits; there is nothing to look for."
        ask = action("Find what is missing", "diagnose", at="list", disabled=running)
        return [html.P(words), ask, *_any(view, overlays, running)]
    listed = [_candidate(view, one, overlays) for one in found["candidates"]]
    notes = [html.P(note, className="note") for note in found["notes"]]
    head = html.P(f"Verdict: {found['in_words']}", className="verdict")
    notes.append(html.P(_remains(view, found["remaining_rms"]), className="note"))
    if not listed:
        return [head, *notes, *_any(view, overlays, running)]
    lead = html.P("Tick one to see what would remain; tick two to see them side by side.")
    return [head, *notes, lead, html.Div(listed, className="candidates"), *_any(view, overlays, running)]


def _remains(view: View, remaining: Mapping[str, float]) -> str:
    """Return what would remain, beyond the noise where that is known, with all that the verdict names."""
    each = (f"{name} {value:.2g} {view.unit(view.joints.index(name))}" for name, value in remaining.items())
    beyond = "beyond the noise" if view.judged else "the noise included"
    return f"What stays unexplained, rms {beyond}: {', '.join(each)}."


def _candidate(view: View, one: Mapping[str, Any], overlays: Sequence[str]) -> html.Div:
    label = str(one["label"])
    named = label in (view.diagnosis or {}).get("named", [])
    key = f"{CANDIDATE}{label}"
    ticked = key in overlays
    box = dcc.Checklist(
        id={"tick": key},
        options=[{"label": label, "value": key, "disabled": not one["can_be_added"]}],
        value=[key] if ticked else [],
    )
    best = max(one["residual_mse_before"], key=lambda n: one["residual_mse_before"][n] - one["residual_mse_after"][n])
    before, after = one["residual_mse_before"][best] ** 0.5, one["residual_mse_after"][best] ** 0.5
    unit = view.unit(view.joints.index(best))
    line = f"explains {100 * one['explained']:.0f} %; {best} {before:.3g} to {after:.3g} {unit} rms"
    if one["validation_mse_after"]:
        first, then = (one[f"validation_mse_{key}"][best] ** 0.5 for key in ("before", "after"))
        line += f", validation {first:.3g} to {then:.3g}"
    out: list[Any] = [
        html.Div([box, html.Span("missing" if named else "", className="tag")], className="line"),
        html.Span(line),
    ]
    if ticked or named:
        out += _details(one)
    return html.Div(out, className="candidate" + (" named" if named else ""))


def _details(one: Mapping[str, Any]) -> list[Any]:
    out: list[Any] = [html.P(f"{one['meaning']}: {one['equation']}")]
    out += [html.Div(_parameter(p)) for p in one["parameters"]]
    if one["tied_with"]:
        out.append(html.P(f"These recordings cannot tell it from {', '.join(one['tied_with'])}."))
        if one["experiment"]:
            out.append(html.P(f"What would tell: {one['experiment']}"))
    return out


def _parameter(one: Mapping[str, Any]) -> str:
    """Return a value with its uncertainty; one of a grid, a side or a number of teeth, has none."""
    spread = f" ± {one['std']:.2g}" if one["std"] else ""
    return f"{one['name']} = {one['value']:.4g}{spread} {one['unit']}"


def _any(view: View, overlays: Sequence[str], running: bool) -> list[Any]:
    """Return a way to look at an effect that is not listed, and those that were looked at so."""
    listed = [str(one["label"]) for one in (view.diagnosis or {"candidates": []})["candidates"]]
    own = [label for label in view.previews if label not in listed]
    boxes = [
        dcc.Checklist(
            id={"tick": f"{CANDIDATE}{label}"},
            options=[{"label": label, "value": f"{CANDIDATE}{label}"}],
            value=[f"{CANDIDATE}{label}"] if f"{CANDIDATE}{label}" in overlays else [],
        )
        for label in own
    ]
    options = [label for label in view.comparison["possible"] if label not in view.previews]
    chooser = html.Div(
        [
            dcc.Dropdown(id={"other": "effect"}, options=options, placeholder="any other effect of the catalogue"),
            action("Show", "preview", at="list", disabled=running),
        ],
        className="line",
    )
    return [*boxes, chooser]
