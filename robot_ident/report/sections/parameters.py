"""The parameters with their uncertainty, before and after."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.figures.parameters import parameters_figure, parameters_text
from robot_ident.model.model import Model
from robot_ident.report.findings import Findings
from robot_ident.report.section import Plot, Section, Table
from robot_ident.report.words import NOTHING, joined, with_sigma

_UNSURE = 2.0  # sigmas of its value that a parameter must have to be told from zero


@dataclass(frozen=True)
class Parameters(Section):
    """Every parameter of the last model, beside the first one's where there are two."""

    found: Findings

    title = "Parameters"
    template = "parameters.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the table, those that are badly known, and how far they moved."""
        before, after = self.found.ends[0], self.found.ends[-1]
        was = _values(before.model) if before is not after else {}
        unsure = [p.name for p, value, std in _rows(after.model) if std > 0.0 and abs(value) < _UNSURE * std]
        resting = {p.name for p, at_bound in zip(after.model.parameters, after.model.at_bound, strict=True) if at_bound}
        header = ["parameter", "value", "sigma", "unit", "sigma / value", "meaning"]
        rows = []
        for p, value, std in _rows(after.model):
            share = "at its bound" if p.name in resting else _share(value, std)
            row = [p.name, f"{value:.4g}", f"{std:.2g}" if std else NOTHING, p.unit, share, p.meaning]
            if was:
                row[1:1] = [with_sigma(*was[p.name]) if p.name in was else NOTHING]
            rows.append(row)
        if was:
            header[1:1] = [f"in {before.name}"]
        numeric = (1, 2, 3, 5) if was else (1, 2, 4)
        figure = Plot(parameters_figure(before.model, after.model), parameters_text(before.model, after.model))
        return {
            "figures": Table(header, rows, numeric),
            "model": after.name,
            "unsure": joined(unsure),
            "count": len(rows),
            "moved": figure if was else None,
            "before": before.name,
            "condition": f"{after.model.condition_number:.4g}",
            "determinant": f"{after.model.log10_det_covariance:.2f}",
            "estimator": after.model.estimator,
            "notes": list(after.model.notes),
        }


def _rows(model: Model) -> list[tuple[Any, float, float]]:
    """Return parameters with value and standard deviation, 0 where there is none."""
    told = zip(model.parameters, model.values, model.std, model.at_bound, strict=True)
    return [(p, float(v), 0.0 if at_bound else float(s)) for p, v, s, at_bound in told]


def _values(model: Model) -> dict[str, tuple[float, float]]:
    return {p.name: (value, std) for p, value, std in _rows(model)}


def _share(value: float, std: float) -> str:
    if not std:
        return "given"
    share = 100.0 * std / abs(value) if value else float("inf")
    return f"{share:.1f} %" if share < 100.0 / _UNSURE else "badly known"
