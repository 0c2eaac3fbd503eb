"""Where a result comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from robot_ident.report.section import Section


@dataclass(frozen=True)
class Provenance(Section):
    """Options and versions that give a result again."""

    entries: Mapping[str, Any]

    title = "Provenance"
    template = "provenance.html.j2"

    def context(self) -> Mapping[str, Any]:
        """Return the entries as lines."""
        return {"entries": [(name, _words(value)) for name, value in self.entries.items()]}


def _words(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return ", ".join(str(item) for item in value) or "none"
    return "none" if value is None else str(value)
