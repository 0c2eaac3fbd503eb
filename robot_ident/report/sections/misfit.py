"""Where models fail: in words, over velocity, position and load, and by frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robot_ident.diagnosis.beside import beside
from robot_ident.diagnosis.comparison import JointComparison
from robot_ident.diagnosis.residual_lines import ResidualLines, residual_lines
from robot_ident.diagnosis.staircase import Step
from robot_ident.figures.residual_lines import LINES, residual_lines_figure, residual_lines_text, together
from robot_ident.figures.residual_over import residual_over_figure, residual_over_text
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section, Table
from robot_ident.report.words import percent, short

_SENTENCES = 4  # regions named for a joint
_SHARE = 0.005  # of the excess from which on a variable is listed


@dataclass(frozen=True)
class Misfit(Section):
    """Where the first and the last model fail."""

    found: Findings

    title = "Where it fails"
    template = "misfit.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return sentences and tables of the joints that a model does not fit, and the figures."""
        besides = {s.name: [beside(s.model, one.measured) for one in self.found.training] for s in self.found.ends}
        models = [self._model(step) for step in self.found.ends]
        lines = {
            name: [residual_lines(b, source.measured) for b, source in zip(found, self.found.training, strict=True)]
            for name, found in besides.items()
        }
        return {
            "models": models,
            "over": Plot(residual_over_figure(besides), residual_over_text(besides)),
            "lines": self._lines(lines),
        }

    def _model(self, step: Step) -> dict[str, Any]:
        """Return the joints that a model does not fit: in words, and what their excess depends on."""
        robot, failing = self.found.robot, [joint for joint in step.comparison.joints if joint.explained_by]
        told = []
        for joint in failing:
            number = robot.joint_index(joint.name)
            beyond = "residual, noise included" if joint.noise_variance is None else "excess over the noise"
            excess = f"{short(joint.excess)} {robot.torque_unit(number)} rms {beyond}"
            words = [region.in_words(robot, number) for region in joint.worst[:_SENTENCES]]
            told.append({"name": joint.name, "excess": excess, "words": words, "reversal": _reversal(joint)})
        return {"name": step.name, "joints": told, "shares": _shares(failing)}

    def _lines(self, lines: Mapping[str, list[ResidualLines]]) -> list[Plot]:
        """Return the lines of all recordings together, or, where they don't share their frequencies, of each."""
        sources = self.found.training
        joint = {name: one for name, found in lines.items() if (one := together(found)) is not None}
        if len(joint) == len(lines):
            count = len(sources)
            caption = f"Root mean square over {count} recordings. " if count > 1 else ""
            return [_line_plot(joint, count, self.found, caption)]
        return [
            _line_plot({name: found[k] for name, found in lines.items()}, 1, self.found, f"{source.path}. ")
            for k, source in enumerate(sources)
        ]


def _line_plot(lines: Mapping[str, ResidualLines], count: int, found: Findings, caption: str) -> Plot:
    figure = residual_lines_figure(lines, found.robot, count)
    drawn = len(next(iter(lines.values())).frequency)
    if drawn > LINES:
        caption += f"Of {drawn} lines the extremes of {LINES // 2} stretches of frequency are drawn."
    return Plot(figure, residual_lines_text(lines, found.robot, count), caption.strip())


def _shares(joints: Sequence[JointComparison]) -> Table:
    """Return what a curve over each variable, and each band of frequency, holds of every joint's excess."""
    variables = dict.fromkeys(name for joint in joints for name in joint.explained_by)
    bands = dict.fromkeys((low, high) for joint in joints for low, high, _ in joint.by_frequency)
    held = {name.replace("_", " "): [joint.explained_by.get(name, 0.0) for joint in joints] for name in variables}
    for low, high in bands:
        parts = [{(a, b): part for a, b, part in joint.by_frequency} for joint in joints]
        held[f"{low:g} to {high:g} Hz"] = [one.get((low, high), 0.0) for one in parts]
    rows = [(name, *(percent(share) for share in of)) for name, of in held.items() if max(of) >= _SHARE]
    return Table(("share of the excess", *(joint.name for joint in joints)), rows, range(1, len(joints) + 1))


def _reversal(joint: JointComparison) -> str:
    if joint.odd is None or joint.even is None:
        return ""
    return (
        f"Under time reversal {percent(joint.odd)} of it is odd, as friction is, and {percent(joint.even)} even, as"
        " gravity, springs and inertia are."
    )
