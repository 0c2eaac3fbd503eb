"""Candidates for what a model lacks: how much of its error each predicts on motion that it was not fitted to."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_ident.diagnosis.diagnosis import Diagnosis, Finding
from robot_ident.figures.theme import BLUE, GREY, plain, themed

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
