"""The tree of steps, and what is laid side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dash import html

from robot_ident.report.wording import NOTHING, short
from robot_ident.workbench.panels.action import action
from robot_ident.workbench.panels.tick import tick
from robot_ident.workbench.view import CANDIDATE, STEP, Overlay, View


def tree(view: View, overlays: Sequence[str]) -> list[Any]:
    """Return all steps, alternatives indented alike, with a way to go to each and to lay it over the present one."""
    steps = view.session.steps
    out: list[Any] = []

    def grow(number: int, depth: int) -> None:
        out.append(_line(view, number, depth, overlays))
        for child in steps.values():
            if child.parent == number:
                grow(child.number, depth + 1)

    grow(min(steps), 0)
    return [
        html.Ul(out, className="steps"),
        html.P(
            "Undo loses nothing: the step stays. Add another effect to an earlier step to have two alternatives.",
            className="note",
        ),
    ]


def _line(view: View, number: int, depth: int, overlays: Sequence[str]) -> html.Li:
    step = view.session.steps[number]
    label = f"{number}: + {step.added}" if step.added else f"{number}: the model to begin with"
    here = number == view.number
    key = f"{STEP}{number}"
    parts: list[Any] = [action(label, "go", str(number), "tree", className="chosen" if here else "")]
    if not here:
        parts.append(tick("beside", key, ticked=key in overlays))
    return html.Li(parts, style={"marginLeft": f"{1.2 * depth}em"})


def side_by_side(view: View, overlays: Sequence[Overlay], running: bool) -> list[Any]:
    """Return the errors of the present step and of what is laid over it, by joint, training and validation."""
    if not overlays:
        return [html.P("Tick candidates or steps (two at most) to see them beside the present model.")]
    errors = view.errors
    columns: list[tuple[str, Mapping[str, Any], Mapping[str, Any] | None]] = [
        (f"step {view.number}, now", errors["training"], errors["validation"]),
        *((one.words, one.training, one.validation) for one in overlays),
    ]
    heads = [html.Th(_broken(words), scope="col", className=f"overlay{k}") for k, (words, _, _) in enumerate(columns)]
    head = html.Tr([html.Th(f"{view.unit(0)} rms"), *heads, html.Th("noise", scope="col")])
    parts = [_part("training", view, columns, unseen=False)]
    if errors["validation"] is not None:
        parts.append(_part("validation", view, columns, unseen=True))
    buttons = [
        action(f"Add {label}", "add", label, "table", disabled=running)
        for label in (one.key.removeprefix(CANDIDATE) for one in overlays if one.key.startswith(CANDIDATE))
        if view.session.find(view.number, label) is None
    ]
    return [html.Table([html.Thead(head), *parts], className="numbers"), html.Div(buttons, className="line")]


def _part(
    name: str,
    view: View,
    columns: Sequence[tuple[str, Mapping[str, Any], Mapping[str, Any] | None]],
    *,
    unseen: bool,
) -> html.Tbody:
    """Return the rows of all joints, on training or on validation."""
    head = html.Tr(html.Th(name, scope="rowgroup", colSpan=len(columns) + 2), className="part")
    return html.Tbody([head, *(_row(view, joint, unseen, columns) for joint in range(len(view.joints)))])


def _row(
    view: View, joint: int, unseen: bool, columns: Sequence[tuple[str, Mapping[str, Any], Mapping[str, Any] | None]]
) -> html.Tr:
    name = view.joints[joint]
    values = [unseen_errors if unseen else training for _, training, unseen_errors in columns]
    noise = view.errors["validation_noise" if unseen else "noise"][name]
    cells = [NOTHING if one is None else _rms(one[name]) for one in values]
    unit = "" if view.unit(joint) == view.unit(0) else f", {view.unit(joint)}"
    return html.Tr([html.Th(f"{name}{unit}", scope="row"), *(html.Td(cell) for cell in cells), html.Td(_rms(noise))])


def _broken(words: str) -> list[Any]:
    """Return a heading in short lines."""
    first, at, joint = words.partition("@")
    parts = first.replace("_", "_\u200b")  # may be broken after an underscore
    return [parts, html.Br(), f"{at}{joint}"] if at else [words]


def _rms(mean_square: float | None) -> str:
    return NOTHING if mean_square is None else short(mean_square**0.5, 4)
