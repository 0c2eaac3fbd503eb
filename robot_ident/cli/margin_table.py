"""The margins of a motion as users read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_ident.cli.output import table

if TYPE_CHECKING:
    from robot_ident.excitation.margins import Margins

_HEAD = ("limit", "joint, rule or links", "reached", "allowed", "margin", "unit", "at t [s]", "by")


def margin_table(margins: Margins) -> str:
    """Return the tightest point of every limit, and below what was left out on purpose."""
    rows = [item.cells for item in margins.items]
    return "\n".join([table(_HEAD, rows), *margins.notes])
