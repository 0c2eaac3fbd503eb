"""Bars: the evidence of candidates; parameters of two models beside each other, in units of their uncertainty; the
standard deviation that a design promises for every parameter, beside Table II and section IV of Swevers et al. (1997)
on the KUKA IR 361, for the paper's 21 parameters and one averaged period: 1500 samples a joint, torque noise of
variance 25, 26, 10 (Nm)^2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.design.design import DesignResult
from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.figures.theme import BLUE, GREY, ORANGE, model_colour, plain, themed
from robot_ident.model.model import Model
from robot_ident.paper.printed import PARAMETERS, SIGMA

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


_LINE = 22  # px of a parameter


def parameters_figure(before: Model, after: Model) -> Figure:
    """Return how far each parameter that two models share has moved, (after - before) / sigma before, with the 95 %
    interval of either: 2 sigma on either side.
    """
    from plotly.graph_objects import Figure

    shared = _shared(before, after)
    figure = Figure()
    for number, (label, moved, wide) in enumerate(
        (
            ("before", [0.0] * len(shared), [2.0] * len(shared)),
            ("after", [one[1] for one in shared], [2.0 * one[2] for one in shared]),
        )
    ):
        figure.add_scatter(
            y=[plain(one[0]) for one in shared],
            x=moved,
            error_x={"type": "data", "array": wide, "thickness": 1.5},
            mode="markers",
            name=f"{label}, ± 2 sigma",
            marker={"color": model_colour(number, 2), "symbol": ("square-open", "circle")[number], "size": 8},
            hovertemplate="%{y}: moved by %{x:.2f} sigma<extra>" + label + "</extra>",
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


def is_paper_model(robot: str, parameters: Sequence[str]) -> bool:
    """Return whether a design is for the paper's robot and its 21 parameters."""
    return robot == "kuka_ir361" and tuple(parameters) == PARAMETERS


def sigma_figure(found: DesignResult, units: tuple[str, ...]) -> Figure:
    """Return the standard deviations [unit of the parameter] on a logarithmic axis; units [p]."""
    names = [
        f"{name} [{unit.replace('^2', '²')}]" if unit else name
        for name, unit in zip(found.parameters, units, strict=True)
    ]
    series: list[tuple[str, Any, str, str]] = [("this design", np.asarray(found.sigma), BLUE, "circle")]
    if (paper := _paper(found)) is not None:
        series.append(("Swevers et al. 1997, Table II", paper, ORANGE, "diamond-open"))
    return sigmas_over_names(names, series, "standard deviation", 520)


def sigmas_over_names(
    names: Sequence[str], series: Sequence[tuple[str, Any, str, str]], title: str, height: int
) -> Figure:
    """Return (label, standard deviations [p], colour, symbol) over the names of parameters, on a logarithmic axis."""
    from plotly.graph_objects import Figure

    figure = Figure()
    for label, values, colour, symbol in series:
        figure.add_scatter(
            x=list(names),
            y=values,
            mode="markers",
            name=label,
            marker={"color": colour, "symbol": symbol, "size": 9, "line": {"width": 2, "color": colour}},
            hovertemplate="%{x}: %{y:.4g}<extra>" + label + "</extra>",
        )
    figure.update_yaxes(title_text=title, type="log", dtick="D2")
    figure.update_xaxes(tickangle=-60, showgrid=True)
    return themed(figure, height=height)


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


if TYPE_CHECKING:
    from plotly.graph_objects import Figure


_BAR = 34  # px


def candidates_figure(found: Diagnosis) -> Figure:
    """Return a bar for each candidate: the share [%] of the excess on its joints that it removes on trajectories left
    out of the fit; those named missing are filled, the others hatched.
    """
    from plotly.graph_objects import Figure

    figure = Figure()
    for label, findings, colour, pattern in (
        ("named missing", found.missing, BLUE, ""),
        ("not named", found.others, GREY, "/"),
    ):
        if findings:
            figure.add_bar(
                y=[plain(finding.label) for finding in findings],
                x=[100.0 * finding.explained for finding in findings],
                orientation="h",
                name=label,
                text=[_share(finding) for finding in findings],
                textposition="outside",
                cliponaxis=False,
                marker={"color": colour, "pattern": {"shape": pattern}},
                hovertemplate="%{y}: %{x:.1f} %<extra>" + label + "</extra>",
            )
    order = [plain(finding.label) for finding in (*found.missing, *found.others)]
    figure.update_yaxes(categoryorder="array", categoryarray=order[::-1], automargin=True, showgrid=False)
    title = "of the excess error explained on motion left out [%]"
    figure.update_xaxes(title_text=title, range=[0, 112], tickvals=[0, 20, 40, 60, 80, 100])
    return themed(figure, height=130 + _BAR * len(order))


def _share(finding: Finding) -> str:
    tied = f", {len(finding.tied_with)} indistinguishable" if finding.tied_with else ""
    return f"{100 * finding.explained:.0f} %{tied}"


def candidates_text(found: Diagnosis) -> str:
    """Return the candidates with their shares, in their order."""
    listed = [(finding, "named") for finding in found.missing] + [(finding, "not named") for finding in found.others]
    if not listed:
        return "No candidate explains anything."
    return "; ".join(f"{s.label}, {word}: {100 * s.explained:.0f} %" for s, word in listed) + " of the excess."
