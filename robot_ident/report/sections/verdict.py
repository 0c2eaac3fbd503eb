"""The verdict in one sentence, and the figures that it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.report.findings import Findings
from robot_ident.report.section import Section, Table
from robot_ident.report.verdict import verdict
from robot_ident.report.words import NOTHING, short


@dataclass(frozen=True)
class Verdict(Section):
    """What a reader who stops here takes away."""

    found: Findings

    title = "Verdict"
    template = "verdict.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the sentence, how the last model fares at each joint, and what limits the judgement."""
        last, unseen = self.found.last, bool(self.found.last.validation)
        header = ["joint", "residual", "noise", "excess rms", "chi²/dof", "p", ""]
        rows = []
        for joint in last.comparison.joints:
            fit, noise = joint.misfit, joint.noise_variance
            figures = (
                joint.residual_mse**0.5,
                None if noise is None else noise**0.5,
                None if noise is None else joint.excess,
            )
            row = [joint.name, *(short(value) for value in figures)]
            row += [NOTHING, NOTHING] if fit is None else [short(fit.statistic), f"{fit.p_value:.2g}"]
            row.append(joint.in_words)
            if unseen:
                level = last.validation[joint.name]
                row += [short(level.rms), short(level.noise)]
            rows.append(row)
        if unseen:
            header += ["on validation", "its noise"]
        notes = dict.fromkeys((*self.found.diagnosis.notes, *last.comparison.notes))
        units = sorted({self.found.robot.torque_unit(k) for k in range(self.found.robot.n)})
        return {
            "verdict": verdict(self.found),
            "model": last.path,
            "unit": ", ".join(units),
            "figures": Table(header, rows, numeric=(1, 2, 3, 4, 5, 7, 8)),
            "unseen": unseen,
            "notes": list(notes),
        }
