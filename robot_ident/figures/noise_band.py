"""The band in which noise alone lies, behind a residual."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_ident.figures.models import NOISE

if TYPE_CHECKING:
    from plotly.graph_objects import Scatter


def noise_band(start: float, end: float, wide: float, label: str, *, shown: bool) -> Scatter:
    """Return the band from -wide to wide between two abscissas; `shown`: it has an entry in the legend."""
    from plotly.graph_objects import Scatter

    return Scatter(
        x=[start, end, end, start],
        y=[-wide, -wide, wide, wide],
        fill="toself",
        fillcolor=NOISE,
        line={"width": 0},
        mode="lines",
        name=label,
        legendgroup=label,
        showlegend=shown,
        hoverinfo="skip",
    )
