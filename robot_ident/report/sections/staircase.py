"""The excess over noise from model to model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.diagnosis.staircase import Level
from robot_ident.figures.staircase import staircase_figure, staircase_text
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section, Table
from robot_ident.report.words import NOTHING, joined, short


@dataclass(frozen=True)
class Staircase(Section):
    """Excess over noise of every model, on fitted recordings and on the validation, with residual and noise."""

    found: Findings

    title = "Error reduction"
    template = "staircase.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the figure and its numbers."""
        steps, foreseen = self.found.steps, self.found.foreseen
        listed = [(step.name, step.added, step.training, step.validation) for step in steps]
        if foreseen is not None:
            listed.append(("predicted", foreseen.added, foreseen.training, foreseen.validation))
        rows = [
            (name, joined(added), joint, *_figures(training.get(joint)), *_figures(validation.get(joint)))
            for name, added, training, validation in listed
            for joint in self.found.robot.joints
        ]
        kinds = ("excess", "residual", "noise", "excess, validation", "residual", "noise")
        return {
            "figure": Plot(staircase_figure(steps, foreseen), staircase_text(steps)),
            "figures": Table(("model", "adds", "joint", *kinds), rows, numeric=(3, 4, 5, 6, 7, 8)),
            "foreseen": None if foreseen is None else joined(foreseen.added),
            "how": self._how(),
        }

    def _how(self) -> str:
        """Return how the residual on the validation was taken."""
        kinds = {source.measured.base_frequency is not None for source in self.found.validation}
        if not kinds:
            return ""
        if kinds == {True}:
            return "Validation: averaged periods, as on the fitted recordings."
        return "Validation: samples that move, low-passed."


def _figures(level: Level | None) -> tuple[str, str, str]:
    """Return excess, residual and noise in words; no excess where the noise is unknown."""
    if level is None:
        return NOTHING, NOTHING, NOTHING
    excess = NOTHING if level.noise is None else short(level.excess)
    return excess, short(level.rms), short(level.noise)
