"""The motions that were played, and how far they stay from the robot's limits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.report.findings import Findings
from robot_ident.report.section import Section
from robot_ident.report.sections.margins import LimitMargins
from robot_ident.report.sections.trajectory import Trajectory


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
