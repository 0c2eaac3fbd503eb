"""How far a motion stays from every limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.excitation.margins import Margins
from robot_ident.report.section import Section, Table

_HEADER = ("limit", "joint or rule", "reached", "allowed", "margin", "unit", "at t [s]", "by")


@dataclass(frozen=True)
class LimitMargins(Section):
    """The margins of a motion, or the tightest of several."""

    margins: Margins
    several: bool = False

    title = "Limits"
    template = "margins.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the table."""
        rows = [item.cells for item in self.margins.items]
        table = Table(_HEADER, rows, numeric=(2, 3, 4, 6))
        return {"margins": table, "several": self.several, "unknown": self.margins.unknown}
