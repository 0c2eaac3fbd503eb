"""The motion of the joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.excitation import Excitation
from robot_ident.figures.trajectory import trajectory_figure, trajectory_text
from robot_ident.report.section import Plot, Section
from robot_ident.robot.robot import Robot


@dataclass(frozen=True)
class Trajectory(Section):
    """Position, velocity and acceleration; `number` where there are several motions."""

    excitation: Excitation
    robot: Robot
    number: int | None = None

    title = "Motion of the joints"
    template = "one_plot.html.j2"

    @property
    def heading(self) -> str:
        """The title, with the number of the motion."""
        return self.title if self.number is None else f"{self.title}, motion {self.number}"

    def context(self) -> Mapping[str, Any]:
        """Return the figure."""
        caption = "One period. Dashed: limits of the joint of that colour, grey where joints share one."
        figure = trajectory_figure(self.excitation, self.robot)
        return {"figure": Plot(figure, trajectory_text(self.excitation, self.robot), caption)}
