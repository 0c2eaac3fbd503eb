"""What the design promises for every parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.design import DesignResult
from robot_ident.figures.sigma import sigma_figure, sigma_text
from robot_ident.report.section import Plot, Section


@dataclass(frozen=True)
class Sigma(Section):
    """Standard deviations of all parameters; units [p]."""

    found: DesignResult
    units: tuple[str, ...]

    title = "How well each parameter will be known"
    template = "one_plot.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the figure."""
        periods = self.found.excitation.achieved["periods"]
        caption = (
            f"Standard deviations after {periods} averaged periods, with the torque noise that the robot is given."
        )
        return {"figure": Plot(sigma_figure(self.found, self.units), sigma_text(self.found), caption)}
