"""The falling error from model to model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.figures.staircase import staircase_figure, staircase_text
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section, Table
from robot_ident.report.words import NOTHING, joined, short


@dataclass(frozen=True)
class Staircase(Section):
    """Residual of every model, on fitted recordings and on others, beside the noise."""

    found: Findings

    title = "The falling error"
    template = "staircase.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the figure and its numbers."""
        steps, foreseen = self.found.steps, self.found.foreseen
        listed = [(step.name, step.added, step.training, step.validation) for step in steps]
        if foreseen is not None:
            listed.append(("predicted", foreseen.added, foreseen.training, foreseen.validation))
        rows = []
        for name, added, training, validation in listed:
            for joint in self.found.robot.joints:
                level, unseen = training[joint], validation.get(joint)
                beyond = NOTHING if unseen is None else short(unseen.rms)
                noise = NOTHING if unseen is None else short(unseen.noise)
                rows.append((name, joined(added), joint, short(level.rms), short(level.noise), beyond, noise))
        header = ("model", "adds", "joint", "fitted recordings", "noise", "unseen motion", "noise")
        return {
            "figure": Plot(staircase_figure(steps, foreseen), staircase_text(steps)),
            "figures": Table(header, rows, numeric=(3, 4, 5, 6)),
            "foreseen": None if foreseen is None else joined(foreseen.added),
            "how": self._how(),
        }

    def _how(self) -> str:
        """Return how the residual on unseen motion was taken."""
        kinds = {source.measured.base_frequency is not None for source in self.found.validation}
        if not kinds:
            return ""
        if kinds == {True}:
            return "Unseen motion: averaged periods, as on the fitted recordings."
        return "Unseen motion: samples that move, behind the low pass, as robot_ident validate has them."
