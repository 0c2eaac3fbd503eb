"""The sections of a design's page: what it reached, the motion, its margins, the search."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.design.bound import Bound
from robot_ident.design.design import DesignResult
from robot_ident.figures.parameter_bars import sigma_figure, sigma_text
from robot_ident.figures.tool_path import workspace_figure, workspace_text
from robot_ident.figures.trajectory import convergence_figure, convergence_text, trajectory_figure, trajectory_text
from robot_ident.limits.certifier import Margins
from robot_ident.report.page import Plot, Section, Table
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Excitation
from robot_ident.workflow.findings import Findings


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


@dataclass(frozen=True)
class DesignVerdict(Section):
    """The verdict on a design."""

    found: DesignResult
    bound: Bound | None

    title = "Verdict"
    template = "design_verdict.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the sentence, the figures and the notes."""
        found, bound = self.found, self.bound
        figures = [
            ("log10 det of the covariance", f"{found.log10_det_covariance:.2f}"),
            ("condition number", f"{found.condition_number:.2f}"),
            ("parameters", str(len(found.parameters))),
            ("time of the search", f"{found.seconds:.0f} s"),
        ]
        notes = list(found.notes)
        if bound is not None:
            efficiency = bound.efficiency(found.log10_det_covariance)
            figures[2:2] = [
                ("no trajectory gets below", f"{bound.log10_det_covariance:.2f}"),
                ("D-efficiency, at least", f"{efficiency:.0%}"),
            ]
            notes.append(bound.explanation())
        return {"verdict": self._verdict(), "figures": figures, "notes": notes}

    def _verdict(self) -> str:
        found = self.found
        motion = "The motion keeps" if len(found.excitations) == 1 else f"All {len(found.excitations)} motions keep"
        tightest = found.margins.tightest
        nearest = f"; the tightest: {tightest}" if tightest else ""
        rest = ""
        if self.bound is not None:
            share = self.bound.efficiency(found.log10_det_covariance)
            rest = f" Per parameter it tells at least {share:.0%} of what any motion within them could."
        return f"{motion} every limit{nearest}.{rest}"


_HEADER = ("limit", "joint or rule", "reached", "allowed", "margin", "unit", "at t [s]", "by")


@dataclass(frozen=True)
class LimitMargins(Section):
    """The margins of a motion, or the tightest of several."""

    margins: Margins
    several: bool = False

    title = "Limits"
    template = "margins.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the table."""
        rows = [item.cells for item in self.margins.items]
        table = Table(_HEADER, rows, numeric=(2, 3, 4, 6))
        return {"margins": table, "several": self.several, "unknown": self.margins.unknown}


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


@dataclass(frozen=True)
class Excitations(Section):
    """Every excitation with its margins; a word where none is known."""

    found: Findings

    title = "Excitation"
    template = "excitation.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the motions that are known."""
        motions = []
        for played in self.found.played:
            motion = Trajectory(played.excitation, self.found.robot).context()
            limits = LimitMargins(played.margins).context()
            achieved = played.excitation.achieved
            told = [f"criterion {played.excitation.criterion}"] if played.excitation.criterion else []
            for key, name in (("log10_det_covariance", "log10 det"), ("condition_number", "condition number")):
                if isinstance(achieved.get(key), (int, float)):
                    told.append(f"{name} {achieved[key]:.4g}")
            motions.append(
                {
                    "path": played.path,
                    "told": ", ".join(told),
                    "kept": played.margins.kept,
                    "tightest": str(played.margins.tightest) if played.margins.tightest else "",
                    **motion,
                    **limits,
                }
            )
        return {"motions": motions}


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


@dataclass(frozen=True)
class Provenance(Section):
    """Options and versions that give a result again."""

    entries: Mapping[str, Any]

    title = "Provenance"
    template = "provenance.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the entries as lines."""
        return {"entries": [(name, _words(value)) for name, value in self.entries.items()]}


def _words(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(str(item) for item in value) or "none"
    return "none" if value is None else str(value)


def design_sections(
    found: DesignResult, robot: Robot, units: tuple[str, ...], bound: Bound | None = None
) -> list[Section]:
    """Return the sections of a design's page; units [p] of its parameters."""
    several = len(found.excitations) > 1
    motions: list[Section] = []
    for number, excitation in enumerate(found.excitations, 1):
        shown = number if several else None
        motions += [Trajectory(excitation, robot, shown), Workspace(excitation, robot, shown)]
    return [
        DesignVerdict(found, bound),
        *motions,
        LimitMargins(found.margins, several),
        Sigma(found, units),
        Convergence(found, bound),
        Provenance(found.excitation.reproduce),
    ]
