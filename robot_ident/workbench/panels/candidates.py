"""The candidates of a diagnosis, each with the fall of the error that it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dash import html

from robot_ident.report.wording import short, with_sigma
from robot_ident.workbench.panels.action import action
from robot_ident.workbench.panels.tick import tick
from robot_ident.workbench.view import CANDIDATE, View


def candidates(view: View, overlays: Sequence[str], running: bool) -> list[Any]:
    """Return the verdict and the candidates."""
    found = view.diagnosis
    if found is None:
        words = "Not looked for yet."
        if not view.failing and view.judged:
            words = "The model fits; there is nothing to look for."
        ask = action("Find what is missing", "diagnose", at="list", disabled=running)
        return [html.P(words), ask, *_own(view, overlays)]
    listed = [_candidate(view, one, overlays) for one in found["candidates"]]
    notes = [html.P(note, className="note") for note in found["notes"]]
    head = html.P(f"Verdict: {found['in_words']}", className="verdict")
    notes.append(html.P(_remains(view, found["remaining_rms"]), className="note"))
    if not listed:
        return [head, *notes, *_own(view, overlays)]
    lead = html.P("Tick one to see what would remain; tick two to see them side by side.")
    if not view.judged:
        words = (
            "Without a known noise the model is refitted, weighted by its own residual, before effects are compared."
        )
        notes.append(html.P(words, className="note"))
    return [head, *notes, lead, html.Div(listed, className="candidates"), *_own(view, overlays)]


def _remains(view: View, remaining: Mapping[str, float]) -> str:
    """Return the unexplained excess over the noise, where that is known, with all that the verdict names."""
    each = (f"{name} {short(value)} {view.unit(view.joints.index(name))}" for name, value in remaining.items())
    what = "Unexplained excess over the noise, rms" if view.judged else "Residual, noise included, rms"
    return f"{what}: {', '.join(each)}."


def _candidate(view: View, one: Mapping[str, Any], overlays: Sequence[str]) -> html.Div:
    label = str(one["label"])
    named = label in (view.diagnosis or {}).get("named", [])
    key = f"{CANDIDATE}{label}"
    ticked = key in overlays
    box = tick(label, key, ticked=ticked, disabled=not one["can_be_added"])
    best = max(one["residual_mse_before"], key=lambda n: one["residual_mse_before"][n] - one["residual_mse_after"][n])
    before, after = one["residual_mse_before"][best] ** 0.5, one["residual_mse_after"][best] ** 0.5
    unit = view.unit(view.joints.index(best))
    line = f"explains {100 * one['explained']:.0f} %; {best} {short(before)} to {short(after)} {unit} rms"
    if one["validation_mse_after"]:
        first, then = (one[f"validation_mse_{key}"][best] ** 0.5 for key in ("before", "after"))
        line += f", validation {short(first)} to {short(then)}"
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
    return f"{one['name']} = {with_sigma(one['value'], one['std'] or 0.0)} {one['unit']}"


def _own(view: View, overlays: Sequence[str]) -> list[Any]:
    """Return the effects that are not listed, but were looked at."""
    listed = [str(one["label"]) for one in (view.diagnosis or {"candidates": []})["candidates"]]
    own = [label for label in view.previews if label not in listed]
    return [tick(label, f"{CANDIDATE}{label}", ticked=f"{CANDIDATE}{label}" in overlays) for label in own]


def others(view: View) -> list[str]:
    """Return all other effects that could be looked at."""
    return [label for label in view.comparison["possible"] if label not in view.previews]
