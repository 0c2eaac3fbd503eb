"""What a design reached, in one sentence and a few figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.bound import Bound
from robot_ident.excitation.design import DesignResult
from robot_ident.report.section import Section


@dataclass(frozen=True)
class DesignVerdict(Section):
    """The verdict on a design."""

    found: DesignResult
    bound: Bound | None

    title = "Verdict"
    template = "design_verdict.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the sentence, the figures and the notes."""
        found, bound = self.found, self.bound
        figures = [
            ("log10 det of the covariance", f"{found.log10_det_covariance:.2f}"),
            ("condition number", f"{found.condition_number:.2f}"),
            ("parameters", str(len(found.parameters))),
            ("time of the search", f"{found.seconds:.0f} s"),
        ]
        notes = list(found.notes)
        if bound is not None:
            efficiency = bound.efficiency(found.log10_det_covariance)
            figures[2:2] = [
                ("no trajectory gets below", f"{bound.log10_det_covariance:.2f}"),
                ("D-efficiency, at least", f"{efficiency:.0%}"),
            ]
            notes.append(bound.explanation())
        return {"verdict": self._verdict(), "figures": figures, "notes": notes}

    def _verdict(self) -> str:
        found = self.found
        motion = "The motion keeps" if len(found.excitations) == 1 else f"All {len(found.excitations)} motions keep"
        tightest = found.margins.tightest
        nearest = f"; the tightest: {tightest}" if tightest else ""
        rest = ""
        if self.bound is not None:
            share = self.bound.efficiency(found.log10_det_covariance)
            rest = f" Per parameter it tells at least {share:.0%} of what any motion within them could."
        return f"{motion} every limit{nearest}.{rest}"
