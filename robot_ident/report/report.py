"""The report on models beside recordings."""

from __future__ import annotations

from pathlib import Path

from robot_ident.report.findings import Findings
from robot_ident.report.page import write_page
from robot_ident.report.section import Section
from robot_ident.report.sections.candidates import Candidates
from robot_ident.report.sections.excitation import Excitations
from robot_ident.report.sections.misfit import Misfit
from robot_ident.report.sections.origin import Origin
from robot_ident.report.sections.parameters import Parameters
from robot_ident.report.sections.staircase import Staircase
from robot_ident.report.sections.torque import Fitted, Unseen
from robot_ident.report.sections.verdict import Verdict


def report_sections(found: Findings) -> list[Section]:
    """Return the sections of a report, in the order in which they are read."""
    return [
        Verdict(found),
        Staircase(found),
        Fitted(found),
        Unseen(found),
        Misfit(found),
        Candidates(found),
        Parameters(found),
        Excitations(found),
        Origin(found),
    ]


def write_report(path: Path | str, found: Findings, *, force: bool = False) -> None:
    """Write the page, whole or not at all."""
    title, subtitle = report_title(found)
    write_page(path, title, report_sections(found), subtitle=subtitle, force=force)


def report_title(found: Findings) -> tuple[str, str]:
    """Return title and subtitle of a report."""
    models = ", ".join(step.path for step in found.steps)
    recordings = [source.path for source in (*found.training, *found.validation)]
    return f"{found.robot.name}: model vs. measurement", f"{models}, on {', '.join(recordings)}"
