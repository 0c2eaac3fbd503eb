"""The page of a design."""

from __future__ import annotations

from robot_ident.excitation.bound import Bound
from robot_ident.excitation.design import DesignResult
from robot_ident.report.section import Section
from robot_ident.report.sections.convergence import Convergence
from robot_ident.report.sections.design_verdict import DesignVerdict
from robot_ident.report.sections.margins import LimitMargins
from robot_ident.report.sections.provenance import Provenance
from robot_ident.report.sections.sigma import Sigma
from robot_ident.report.sections.trajectory import Trajectory
from robot_ident.report.sections.workspace import Workspace
from robot_ident.robot.robot import Robot


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
