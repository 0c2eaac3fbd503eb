"""How the search went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.bound import Bound
from robot_ident.excitation.design import DesignResult
from robot_ident.figures.convergence import convergence_figure, convergence_text
from robot_ident.report.section import Plot, Section


@dataclass(frozen=True)
class Convergence(Section):
    """The best value over time."""

    found: DesignResult
    bound: Bound | None

    title = "How the search went"
    template = "one_plot.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the figure."""
        figure = convergence_figure(self.found, self.bound)
        return {"figure": Plot(figure, convergence_text(self.found, self.bound))}
