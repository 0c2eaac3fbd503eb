"""The sections of a design's page: what it reached, the motion, its margins, the search."""

from __future__ import annotations

from collections.abc import Mapping
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


def _one_plot(title: str, plot: Plot) -> Section:
    return Section(title, "one_plot.html.j2", {"figure": plot})


def _verdict_section(found: DesignResult, bound: Bound | None) -> Section:
    """Return the sentence, the figures and the notes."""
    figures = [
        ("log10 det of the covariance", f"{found.log10_det_covariance:.2f}"),
        ("condition number", f"{found.condition_number:.2f}"),
        ("parameters", str(len(found.parameters))),
        ("time of the search", f"{found.seconds:.0f} s"),
    ]
    notes, rest = list(found.notes), ""
    if bound is not None:
        efficiency = bound.efficiency(found.log10_det_covariance)
        figures[2:2] = [
            ("no trajectory gets below", f"{bound.log10_det_covariance:.2f}"),
            ("D-efficiency, at least", f"{efficiency:.0%}"),
        ]
        notes.append(bound.explanation())
        rest = f" Per parameter it tells at least {efficiency:.0%} of what any motion within them could."
    motion = "The motion keeps" if len(found.excitations) == 1 else f"All {len(found.excitations)} motions keep"
    nearest = f"; the tightest: {found.margins.tightest}" if found.margins.tightest else ""
    words = f"{motion} every limit{nearest}.{rest}"
    return Section("Verdict", "design_verdict.html.j2", {"verdict": words, "figures": figures, "notes": notes})


def _margins(margins: Margins) -> dict[str, Any]:
    """Return the table of a motion's margins, or of the tightest of several motions."""
    header = ("limit", "joint or rule", "reached", "allowed", "margin", "unit", "at t [s]", "by")
    rows = [item.cells for item in margins.items]
    return {"margins": Table(header, rows, numeric=(2, 3, 4, 6)), "unknown": margins.unknown}


def _trajectory(excitation: Excitation, robot: Robot) -> Plot:
    """Return position, velocity and acceleration."""
    caption = "One period. Dashed: limits of the joint of that colour, grey where joints share one."
    return Plot(trajectory_figure(excitation, robot), trajectory_text(excitation, robot), caption)


def excitations_section(found: Findings) -> Section:
    """Return every excitation with its margins; a word where none is known."""
    motions = []
    for played in found.played:
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
                "figure": _trajectory(played.excitation, found.robot),
                **_margins(played.margins),
            }
        )
    return Section("Excitation", "excitation.html.j2", {"motions": motions})


def _sigma(found: DesignResult, units: tuple[str, ...]) -> Plot:
    """Return the standard deviations of all parameters; units [p]."""
    periods = found.excitation.achieved["periods"]
    caption = f"Standard deviations after {periods} averaged periods, with the torque noise that the robot is given."
    return Plot(sigma_figure(found, units), sigma_text(found), caption)


def _workspace(excitation: Excitation, robot: Robot) -> Plot:
    """Return the path of the end effector beside the regions that are forbidden to it."""
    rules = [rule.text for rule in robot.workspace]
    caption = f"Rules: {'; '.join(rules)}." if rules else "This robot has no rules of the workspace."
    return Plot(workspace_figure(excitation, robot), workspace_text(excitation, robot), caption)


def provenance_section(entries: Mapping[str, Any]) -> Section:
    """Return options and versions that give a result again, as lines."""
    lines = [(name, _words(value)) for name, value in entries.items()]
    return Section("Provenance", "provenance.html.j2", {"entries": lines})


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
        which = f", motion {number}" if several else ""
        motions.append(_one_plot(f"Motion of the joints{which}", _trajectory(excitation, robot)))
        motions.append(_one_plot(f"Way through the workspace{which}", _workspace(excitation, robot)))
    search = Plot(convergence_figure(found, bound), convergence_text(found, bound))
    return [
        _verdict_section(found, bound),
        *motions,
        Section("Limits", "margins.html.j2", {**_margins(found.margins), "several": several}),
        _one_plot("How well each parameter will be known", _sigma(found, units)),
        _one_plot("How the search went", search),
        provenance_section(found.excitation.reproduce),
    ]
