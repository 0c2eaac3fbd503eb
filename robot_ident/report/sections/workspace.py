"""The way of the end effector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.excitation import Excitation
from robot_ident.figures.workspace import workspace_figure, workspace_text
from robot_ident.report.section import Plot, Section
from robot_ident.robot.robot import Robot


@dataclass(frozen=True)
class Workspace(Section):
    """The path of the end effector beside the regions that are forbidden to it."""

    excitation: Excitation
    robot: Robot
    number: int | None = None

    title = "Way through the workspace"
    template = "one_plot.html.j2"

    @property
    def heading(self) -> str:
        """The title, with the number of the motion."""
        return self.title if self.number is None else f"{self.title}, motion {self.number}"

    def context(self) -> Mapping[str, Any]:
        """Return the figure."""
        rules = [rule.text for rule in self.robot.workspace]
        caption = f"Rules: {'; '.join(rules)}." if rules else "This robot has no rules of the workspace."
        figure = workspace_figure(self.excitation, self.robot)
        return {"figure": Plot(figure, workspace_text(self.excitation, self.robot), caption)}
