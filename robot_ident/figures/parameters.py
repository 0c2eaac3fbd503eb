"""Parameters of two models beside each other, in units of their uncertainty."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_ident.figures.models import model_colour, plain
from robot_ident.figures.theme import themed
from robot_ident.model.model import Model

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_LINE = 22  # px of a parameter


def parameters_figure(before: Model, after: Model) -> Figure:
    """Return how far each parameter that two models share has moved, (after - before) / sigma before, with the 95 %
    interval of either: 2 sigma on either side.
    """
    from plotly.graph_objects import Figure, Scatter

    shared = _shared(before, after)
    figure = Figure()
    for number, (label, moved, wide) in enumerate(
        (
            ("before", [0.0] * len(shared), [2.0] * len(shared)),
            ("after", [one[1] for one in shared], [2.0 * one[2] for one in shared]),
        )
    ):
        figure.add_trace(
            Scatter(
                y=[plain(one[0]) for one in shared],
                x=moved,
                error_x={"type": "data", "array": wide, "thickness": 1.5},
                mode="markers",
                name=f"{label}, ± 2 sigma",
                marker={"color": model_colour(number, 2), "symbol": ("square-open", "circle")[number], "size": 8},
                hovertemplate="%{y}: moved by %{x:.2f} sigma<extra>" + label + "</extra>",
            )
        )
    figure.update_yaxes(autorange="reversed", automargin=True, dtick=1)
    figure.update_xaxes(title_text="moved, in sigma of the model before")
    return themed(figure, height=130 + _LINE * len(shared))


def _shared(before: Model, after: Model) -> list[tuple[str, float, float]]:
    """Return (name, move, sigma after), both in sigma before, of the parameters that both models have."""
    was = {p.name: (v, s) for p, v, s in zip(before.parameters, before.values, before.std, strict=True) if s > 0}
    out = []
    for p, value, std in zip(after.parameters, after.values, after.std, strict=True):
        if p.name in was:
            old, sigma = was[p.name]
            out.append((p.name, float((value - old) / sigma), float(std / sigma)))
    return out


def parameters_text(before: Model, after: Model) -> str:
    """Return which parameters moved by more than 2 sigma, and which became less certain."""
    shared = _shared(before, after)
    moved = [f"{name} by {move:+.1f} sigma" for name, move, _ in shared if abs(move) > 2.0]
    wider = [f"{name} {ratio:.1f} times" for name, _, ratio in shared if ratio > 1.5]
    text = f"Of {len(shared)} parameters, " + (
        f"these moved by more than 2 sigma: {', '.join(moved)}" if moved else "none moved by more than 2 sigma"
    )
    return text + (f"; wider than before: {', '.join(wider)}." if wider else ".")
