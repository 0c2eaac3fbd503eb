"""The panels of the page: guide, joints, where a joint fails, candidates, steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dash import html

from robot_ident.report.wording import NOTHING, short, with_sigma
from robot_ident.workbench.brushing import Look
from robot_ident.workbench.next_step import STAGES, Next
from robot_ident.workbench.view import CANDIDATE, STEP, Overlay, View, most

_UNPRESSED: dict[str, Any] = {"aria-pressed": "false"}
"""Of buttons of which one is chosen; the page itself says which."""


def action(text: str, do: str, label: str = "", at: str = "", **more: Any) -> html.Button:
    """Return a button: what it does, to which effect or step; at: tells buttons of the same deed apart."""
    return html.Button(text, id={"do": do, "label": label, "at": at}, **more)


def tick(text: str, key: str, *, ticked: bool, disabled: bool = False) -> html.Button:
    """Return a box. It is a button, so that drawing it anew is never taken for a click on it."""
    state: dict[str, Any] = {"role": "checkbox", "aria-checked": str(ticked).lower()}
    return html.Button(text, id={"tick": key}, className="tick", disabled=disabled, **state)


def candidates(view: View, overlays: Sequence[str], running: bool) -> list[Any]:
    """Return the verdict, the candidates, and the effects that are not listed, but were looked at."""
    found = view.diagnosis
    if found is None:
        fits = not view.failing and view.judged
        words = "The model fits; there is nothing to look for." if fits else "Not looked for yet."
        out: list[Any] = [html.P(words), action("Find what is missing", "diagnose", at="list", disabled=running)]
    else:
        remaining = found["remaining_rms"].items()
        each = (f"{name} {short(value)} {view.unit(view.joints.index(name))}" for name, value in remaining)
        what = "Unexplained excess over the noise, rms" if view.judged else "Residual, noise included, rms"
        notes = [*found["notes"], f"{what}: {', '.join(each)}."]
        if found["candidates"] and not view.judged:
            words = "Without a known noise the model is refitted, weighted by its own residual, before effects are"
            notes.append(f"{words} compared.")
        out = [html.P(f"Verdict: {found['in_words']}", className="verdict")]
        out += [html.P(note, className="note") for note in notes]
        if found["candidates"]:
            out.append(html.P("Tick one to see what would remain; tick two to see them side by side."))
            listed = [_candidate(view, one, overlays) for one in found["candidates"]]
            out.append(html.Div(listed, className="candidates"))
    known = [str(one["label"]) for one in (found or {"candidates": []})["candidates"]]
    keys = [(label, f"{CANDIDATE}{label}") for label in view.previews if label not in known]
    first = [html.P(view.trouble, className="verdict")] if view.trouble else []
    return [*first, *out, *(tick(label, key, ticked=key in overlays) for label, key in keys)]


def _candidate(view: View, one: Mapping[str, Any], overlays: Sequence[str]) -> html.Div:
    label = str(one["label"])
    named = label in (view.diagnosis or {}).get("named", [])
    key = f"{CANDIDATE}{label}"
    ticked = key in overlays
    box = tick(label, key, ticked=ticked, disabled=not one["can_be_added"])
    best = most(one["residual_mse_before"], one["residual_mse_after"])
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
    for p in one["parameters"]:  # of a grid, a side or a number of teeth there is no uncertainty
        out.append(html.Div(f"{p['name']} = {with_sigma(p['value'], p['std'] or 0.0)} {p['unit']}"))
    if one["tied_with"]:
        out.append(html.P(f"These recordings cannot tell it from {', '.join(one['tied_with'])}."))
        if one["experiment"]:
            out.append(html.P(f"What would tell: {one['experiment']}"))
    return out


def stages(now: Next) -> list[Any]:
    """Return the loop, with the stage where one stands."""
    here: dict[str, Any] = {"className": "here", "aria-current": "step"}
    return [
        html.Li([html.B(name), html.Span(text)], **(here if name == now.stage else {"className": ""}))
        for name, text in STAGES.items()
    ]


def next_step(now: Next, running: bool) -> list[Any]:
    """Return the words of the next step, and its button."""
    out: list[Any] = [html.P(now.words)]
    if now.button and now.do:
        out.append(action(now.button, now.do, now.label, "next", className="primary", disabled=running))
    return out


def joint_cards(view: View) -> list[Any]:
    """Return a card for every joint: its residual beside the noise, and whether the model fits."""
    out = []
    for joint, found in enumerate(view.comparison["joints"]):
        noise, fails, unit = found["noise_variance"], found["fails"], view.unit(joint)
        worst = ", worst" if joint == view.worst and fails is not False else ""
        lines = [
            html.B(found["name"]),
            html.Span(f"{found['in_words']}{worst}", className="word"),
            html.Span(f"residual {short(found['residual_mse'] ** 0.5)} {unit} rms"),
            html.Span("noise unknown" if noise is None else f"noise {short(noise**0.5)} {unit} rms"),
        ]
        out.append(html.Button(lines, id={"joint": joint}, className="joint fails" if fails else "joint", **_UNPRESSED))
    return out


def recording_buttons(view: View) -> list[Any]:
    """Return a button for every recording; one is drawn over time."""
    names = [f"{one['name']} (validation)" if one["validation"] else str(one["name"]) for one in view.recordings]
    return [
        html.Button(name, id={"recording": place}, title="; ".join(one["notes"]), **_UNPRESSED)
        for place, (name, one) in enumerate(zip(names, view.recordings, strict=True))
    ]


def tree(view: View, overlays: Sequence[str]) -> list[Any]:
    """Return all steps, alternatives indented alike, with a way to go to each and to lay it over the present one."""
    steps = view.session.steps
    out: list[Any] = []

    def grow(number: int, depth: int) -> None:
        added, here, key = steps[number].added, number == view.number, f"{STEP}{number}"
        label = f"{number}: + {added}" if added else f"{number}: the model to begin with"
        parts = [action(label, "go", str(number), "tree", className="chosen" if here else "")]
        if not here:
            parts.append(tick("beside", key, ticked=key in overlays))
        out.append(html.Li(parts, style={"marginLeft": f"{1.2 * depth}em"}))
        for child, step in steps.items():
            if step.parent == number:
                grow(child, depth + 1)

    grow(min(steps), 0)
    return [
        html.Ul(out, className="steps"),
        html.P(
            "Undo loses nothing: the step stays. Add another effect to an earlier step to have two alternatives.",
            className="note",
        ),
    ]


def side_by_side(view: View, overlays: Sequence[Overlay], running: bool) -> list[Any]:
    """Return the errors of the present step and of what is laid over it, by joint, training and validation."""
    if not overlays:
        return [html.P("Tick candidates or steps (two at most) to see them beside the present model.")]
    errors = view.errors
    now = Overlay(f"{STEP}{view.number}", f"step {view.number}, now", [], [], errors["training"], errors["validation"])
    columns = [now, *overlays]
    heads = [html.Th(_broken(one.words), scope="col", className=f"overlay{k}") for k, one in enumerate(columns)]
    head = html.Tr([html.Th(f"{view.unit(0)} rms"), *heads, html.Th("noise", scope="col")])
    bodies = []
    for kind, noise in (("training", "noise"), ("validation", "validation_noise")):
        if errors[kind] is None:
            continue
        rows = [html.Tr(html.Th(kind, scope="rowgroup", colSpan=len(columns) + 2), className="part")]
        for k, joint in enumerate(view.joints):
            unit = "" if view.unit(k) == view.unit(0) else f", {view.unit(k)}"
            every = [*((getattr(one, kind) or {}).get(joint) for one in columns), errors[noise][joint]]
            cells = [html.Td(NOTHING if square is None else short(square**0.5, 4)) for square in every]
            rows.append(html.Tr([html.Th(f"{joint}{unit}", scope="row"), *cells]))
        bodies.append(html.Tbody(rows))
    buttons = [
        action(f"Add {label}", "add", label, "table", disabled=running)
        for label in (one.key.removeprefix(CANDIDATE) for one in overlays if one.key.startswith(CANDIDATE))
        if view.session.find(view.number, label) is None
    ]
    return [html.Table([html.Thead(head), *bodies], className="numbers"), html.Div(buttons, className="line")]


def _broken(words: str) -> list[Any]:
    """Return a heading in short lines."""
    first, at, joint = words.partition("@")
    parts = first.replace("_", "_\u200b")  # may be broken after an underscore
    return [parts, html.Br(), f"{at}{joint}"] if at else [words]


_BARS = 7
_LEAST = 0.005  # less is printed as 0 %


def where(view: View, joint: int) -> list[Any]:
    """Return the regions that hold most of the excess, and the variables that explain it."""
    found = view.comparison["joints"][joint]
    lines = [line for line in (view.trouble, *view.comparison["notes"], *view.unusable) if line]
    notes: list[Any] = [html.P(line, className="note") for line in lines]
    if not found["worst"] and not found["explained_by"]:
        fits = found["fails"] is False
        words = f"{found['name']} fits: there is nothing to look for." if fits else "Nothing stands out."
        return [*notes, html.P(words)]
    sentences = [
        html.Button(words, id={"region": k}, className="sentence", title="find these moments in all pictures")
        for k, words in enumerate(found["worst_in_words"])
    ]
    shares = [(name.replace("_", " "), share) for name, share in found["explained_by"].items() if share >= _LEAST]
    ranked = sorted(shares, key=lambda item: -item[1])
    size = f"{found['name']}: {short(found['excess_rms'])} {view.unit(joint)} rms"
    known = found["noise_variance"] is not None
    beyond = f"{size} {'excess over the noise' if known else 'residual, noise included'}. Most of it is in:"
    explains: list[Any] = [html.P("No single variable explains it (cross-validated).")]
    if ranked:
        rows = []
        for name, share in ranked[:_BARS]:
            bar = html.Td(html.Div(style={"width": f"{100 * share:.0f}%"}), className="bar")
            rows.append(html.Tr([html.Th(name, scope="row"), bar, html.Td(f"{100 * share:.0f} %")]))
        told = html.P("Explained by a curve over each variable (cross-validated):")
        explains = [told, html.Table(rows, className="bars")]
    if found["time_symmetry"]:
        odd, even = (100 * found["time_symmetry"][key] for key in ("odd", "even"))
        explains.append(html.P(f"Under time reversal: {odd:.0f} % odd (friction), {even:.0f} % even (forces, inertia)"))
    return [*notes, html.Div([html.Div([html.P(beyond), *sentences]), html.Div(explains)], className="halves")]


def brushed(look: Look) -> list[Any]:
    """Return what is brushed and what it holds, with a way to let go."""
    low, held = html.Button("Low speed", id={"brush": "low"}, title="the slowest tenth of the time"), look.held()
    if held is None:
        return [low, html.Span("Drag across a picture to find the same moments in all others.")]
    chips = [
        html.Button(f"{look.in_words(one)}  ×", id={"drop": k}, className="chip", title="let go of this region")
        for k, one in enumerate(look.conditions)
    ]
    words = (
        f"{100 * held.share:.0f} % of the excess in {100 * held.of_time:.0f} % of the time;"
        f" {short(held.rms)} {look.unit} rms in {held.rows} samples of the training recordings"
    )
    return [low, *chips, html.Span(words, className="held"), html.Button("Clear", id={"brush": "clear"})]
