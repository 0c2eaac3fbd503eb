"""Measured, predicted and residual torque over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robot_ident.diagnosis.beside import Beside, beside
from robot_ident.figures.extremes import POINTS
from robot_ident.figures.torque import torque_figure, torque_text
from robot_ident.recording.measurement import Source
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section


@dataclass(frozen=True)
class Fitted(Section):
    """One period of every recording, as in the paper's Fig. 4."""

    found: Findings

    title = "Measured and predicted"
    template = "torque.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return a figure for each recording."""
        return {"plots": _plots(self.found, self.found.training), "missing": ""}


@dataclass(frozen=True)
class Unseen(Section):
    """A motion that no model was fitted to, as in the paper's Fig. 5."""

    found: Findings

    title = "On the validation motion"
    template = "torque.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return a figure for each recording to validate on."""
        missing = "None was given; --validation BAG2 adds one: only it shows whether an effect is real."
        return {"plots": _plots(self.found, self.found.validation), "missing": missing}


def _plots(found: Findings, sources: Sequence[Source]) -> list[Plot]:
    plots = []
    for source in sources:
        besides = {step.name: beside(step.model, source.measured) for step in found.ends}
        one = next(iter(besides.values()))
        text = f"{source.path}. {torque_text(besides)}"
        plots.append(Plot(torque_figure(besides), text, torque_caption(source.path, one)))
    return plots


def torque_caption(path: str, one: Beside) -> str:
    """Return what was done to the recording before it is shown."""
    told = [path]
    if one.base_frequency is not None:
        told.append(f"mean of {one.periods} periods of {1.0 / one.base_frequency:.4g} s")
    if one.low_pass is not None:
        told.append(f"measured and predicted torque low-passed at {one.low_pass:g} Hz")
    if len(one.t) > POINTS:
        told.append(f"{len(one.t)} rows; of each curve the extremes of {POINTS // 2} stretches of time are drawn")
    if not one.used.all():
        told.append("residual only where rows count")
    return "; ".join(told) + "."
