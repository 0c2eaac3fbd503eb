"""Where a joint fails, in words that can be clicked, and what its residual depends on."""

from __future__ import annotations

from typing import Any

from dash import html

from robot_ident.report.wording import short
from robot_ident.workbench.brush import Condition, Held
from robot_ident.workbench.symbols import in_words
from robot_ident.workbench.view import View

_BARS = 7
_LEAST = 0.005  # less is printed as 0 %


def where(view: View, joint: int) -> list[Any]:
    """Return the regions that hold most of the excess, and the variables that explain it."""
    found = view.comparison["joints"][joint]
    notes: list[Any] = [html.P(note, className="note") for note in (*view.comparison["notes"], *view.unusable)]
    if not found["worst"] and not found["explained_by"]:
        return [
            *notes,
            html.P(
                f"{found['name']} fits: there is nothing to look for."
                if found["fails"] is False
                else "Nothing stands out."
            ),
        ]
    sentences = [
        html.Button(words, id={"region": k}, className="sentence", title="find these moments in all pictures")
        for k, words in enumerate(found["worst_in_words"])
    ]
    ranked = sorted(((name, share) for name, share in found["explained_by"].items() if share >= _LEAST), key=_share)
    size = f"{found['name']}: {short(found['excess_rms'])} {view.unit(joint)} rms"
    known = found["noise_variance"] is not None
    beyond = f"{size} {'excess over the noise' if known else 'residual, noise included'}. Most of it is in:"
    explains: list[Any] = [html.P("Explained by a curve over each variable (cross-validated):")]
    if ranked:
        explains.append(bars([(name.replace("_", " "), share) for name, share in ranked[:_BARS]]))
    else:
        explains = [html.P("No single variable explains it (cross-validated).")]
    if found["time_symmetry"]:
        odd, even = (100 * found["time_symmetry"][key] for key in ("odd", "even"))
        explains.append(html.P(f"Under time reversal: {odd:.0f} % odd (friction), {even:.0f} % even (forces, inertia)"))
    return [*notes, html.Div([html.Div([html.P(beyond), *sentences]), html.Div(explains)], className="halves")]


def _share(item: tuple[str, float]) -> float:
    return -item[1]


def bars(rows: list[tuple[str, float]]) -> html.Table:
    """Return shares as a table with bars."""
    return html.Table(
        [
            html.Tr(
                [
                    html.Th(name, scope="row"),
                    html.Td(html.Div(style={"width": f"{100 * share:.0f}%"}), className="bar"),
                    html.Td(f"{100 * share:.0f} %"),
                ]
            )
            for name, share in rows
        ],
        className="bars",
    )


def brushed(view: View, joint: int, conditions: list[Condition], held: Held | None) -> list[Any]:
    """Return what is brushed and what it holds, with a way to let go."""
    low = html.Button("Low speed", id={"brush": "low"}, title="the slowest tenth of the time")
    if not conditions or held is None:
        return [low, html.Span("Drag across a picture to find the same moments in all others.")]
    chips = [
        html.Button(f"{in_words(view, joint, one)}  ×", id={"drop": k}, className="chip", title="let go of this region")
        for k, one in enumerate(conditions)
    ]
    words = (
        f"{100 * held.share:.0f} % of the excess in {100 * held.of_time:.0f} % of the time;"
        f" {short(held.rms)} {view.unit(joint)} rms in {held.rows} samples of the training recordings"
    )
    return [low, *chips, html.Span(words, className="held"), html.Button("Clear", id={"brush": "clear"})]
