"""The standard deviation that a design promises for every parameter, beside the paper's Table II for its robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.excitation.design import DesignResult
from robot_ident.figures.paper import SIGMA, is_paper_model
from robot_ident.figures.theme import BLUE, ORANGE, themed

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def sigma_figure(found: DesignResult, units: tuple[str, ...]) -> Figure:
    """Return the standard deviations [unit of the parameter] on a logarithmic axis; units [p]."""
    from plotly.graph_objects import Figure, Scatter

    names = [
        f"{name} [{unit.replace('^2', '²')}]" if unit else name
        for name, unit in zip(found.parameters, units, strict=True)
    ]
    series: list[tuple[str, Any, str, str]] = [("this design", np.asarray(found.sigma), BLUE, "circle")]
    if (paper := _paper(found)) is not None:
        series.append(("Swevers et al. 1997, Table II", paper, ORANGE, "diamond-open"))
    figure = Figure()
    for name, values, colour, symbol in series:
        figure.add_trace(
            Scatter(
                x=names,
                y=values,
                mode="markers",
                name=name,
                marker={"color": colour, "symbol": symbol, "size": 9, "line": {"width": 2, "color": colour}},
                hovertemplate="%{x}: %{y:.4g}<extra>" + name + "</extra>",
            )
        )
    figure.update_yaxes(title_text="standard deviation", type="log", dtick="D2")
    figure.update_xaxes(tickangle=-60, showgrid=True)
    return themed(figure, height=520)


def sigma_text(found: DesignResult) -> str:
    """Return in words what the figure shows."""
    known = f"Standard deviations of {len(found.parameters)} parameters after one averaged period."
    if (paper := _paper(found)) is None:
        return known
    ratio = np.asarray(found.sigma) / paper
    return (
        f"{known} {int(np.sum(ratio < 1.0))} are smaller than in the paper's Table II; the ratio runs from"
        f" {ratio.min():.2f} to {ratio.max():.2f}."
    )


def _paper(found: DesignResult) -> Any:
    criterion = found.excitation.criterion
    if not is_paper_model(found.excitation.robot, found.parameters) or len(found.excitations) > 1:
        return None
    return np.array(SIGMA["condition" if criterion == "condition" else "d-optimal"])
