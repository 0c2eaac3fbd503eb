"""The best value found over the time of a search, beside the bound and the paper's value."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_ident.excitation.bound import Bound
from robot_ident.excitation.design import DesignResult
from robot_ident.figures.paper import CONDITION, LOG10_DET, is_paper_model
from robot_ident.figures.theme import BLUE, GREEN, ORANGE, themed

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def convergence_figure(found: DesignResult, bound: Bound | None = None) -> Figure:
    """Return the criterion's best value over time, as steps, with the bound and (for its robot) the paper's value."""
    from plotly.graph_objects import Figure, Scatter

    seconds, costs = _history(found)
    figure = Figure(
        Scatter(
            x=seconds,
            y=costs,
            mode="lines+markers",
            line={"shape": "hv", "color": BLUE, "width": 2},
            marker={"size": 6},
            name="best so far",
            hovertemplate="%{y:.3f} after %{x:.1f} s<extra></extra>",
        )
    )
    span = [0.0, max(seconds[-1], 1.0)]
    for value, name, colour, dash in _references(found, bound):
        line = {"color": colour, "dash": dash, "width": 2}
        figure.add_trace(Scatter(x=span, y=[value, value], mode="lines", line=line, name=f"{name}: {value:.2f}"))
    figure.update_xaxes(title_text="time of the search [s]", rangemode="tozero")
    title = "condition number" if _by_condition(found) else "log10 det of the covariance"
    figure.update_yaxes(title_text=title)
    return themed(figure, height=380)


def convergence_text(found: DesignResult, bound: Bound | None = None) -> str:
    """Return in words what the figure shows."""
    seconds, costs = _history(found)
    what = "condition number" if _by_condition(found) else "log10 of the determinant"
    references = "".join(f" {name}: {value:.2f}." for value, name, _, _ in _references(found, bound))
    return (
        f"The best {what} fell from {costs[0]:.2f} after {seconds[0]:.1f} s to {costs[-1]:.2f} when the search ended"
        f" after {seconds[-1]:.1f} s.{references}"
    )


def _by_condition(found: DesignResult) -> bool:
    return found.excitation.criterion == "condition"


def _history(found: DesignResult) -> tuple[list[float], list[float]]:
    """Return times and values, the last one at the end of the search."""
    last = found.condition_number if _by_condition(found) else found.log10_det_covariance
    history = [*found.history, (found.seconds, last)]
    return [time for time, _ in history], [cost for _, cost in history]


def _references(found: DesignResult, bound: Bound | None) -> list[tuple[float, str, str, str]]:
    """Return (value, name, colour, dash) of the lines beside the search."""
    out = []
    if is_paper_model(found.excitation.robot, found.parameters):
        value = CONDITION["condition"] if _by_condition(found) else LOG10_DET["d-optimal"]
        out.append((value, "Swevers et al. 1997", ORANGE, "dash"))
    if bound is not None and not _by_condition(found):
        out.append((bound.log10_det_covariance, "no trajectory passes", GREEN, "dot"))
    return out
