"""The page of the paper, section by section."""

from __future__ import annotations

from collections.abc import Sequence

from robot_ident.paper.study import Study
from robot_ident.paper.table_i import table_i
from robot_ident.report.page import Section
from robot_ident.report.paper_design import excitation_section, iteration_section, robot_section
from robot_ident.report.paper_experiment import friction_section, measuring_section, missing_section


def paper_sections(study: Study, sections: Sequence[int]) -> list[Section]:
    """Return the asked sections of the page, computed."""
    made = {
        1: lambda: robot_section(study, table_i(study.robot)),
        2: lambda: excitation_section(study, study.excitations),
        3: lambda: iteration_section(study),
        4: lambda: measuring_section(study, study.measuring),
        5: lambda: friction_section(study, study.friction),
        6: lambda: missing_section(study, study.missing),
    }
    return [made[number]() for number in sections]
