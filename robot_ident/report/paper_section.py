"""A section of the paper's page: what it says, what is found here, the difference, the command that repeats it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.paper.study import Study
from robot_ident.report.page import Plot, Section, Table

NAMES = {"condition": "c1", "d-optimal": "c2"}


@dataclass(frozen=True)
class PaperSection(Section):
    """One section of the paper. says: what is printed; finds: what is found here; items: plots and tables."""

    name: str
    says: str
    finds: Sequence[str]
    items: Sequence[Plot | Table]
    difference: str
    commands: Sequence[str]

    title = "Section of the paper"
    template = "paper.html.j2"

    @property
    def heading(self) -> str:
        """The section's own name."""
        return self.name

    def context(self) -> Mapping[str, Any]:
        """Return texts, plots and tables."""
        return {
            "says": self.says,
            "finds": self.finds,
            "items": self.items,
            "difference": self.difference,
            "commands": self.commands,
        }


def as_markdown(title: str, subtitle: str, sections: Sequence[PaperSection]) -> str:
    """Return texts and tables of the page in Markdown, and in words what its figures show."""
    lines = [f"# {title}", "", subtitle]
    for section in sections:
        lines += ["", f"## {section.name}", "", f"**The paper.** {section.says}"]
        for number, paragraph in enumerate(section.finds):
            lines += ["", f"{'' if number else '**Here.** '}{paragraph}"]
        for item in section.items:
            lines += ["", *(_rows(item) if isinstance(item, Table) else [f"*Figure.* {item.caption} {item.text}"])]
        lines += ["", f"**The difference.** {section.difference}", "", "```sh", *section.commands, "```"]
    return "\n".join(lines) + "\n"


def _rows(table: Table) -> list[str]:
    """Return a table's lines in Markdown."""
    sides = ["--:" if column in table.numeric else "---" for column in range(len(table.header))]
    return ["| " + " | ".join(map(str, row)) + " |" for row in (table.header, sides, *table.rows)]


def again(study: Study, number: int, *more: str) -> list[str]:
    """Return the commands that repeat a section: the page alone, then `more` that do it step by step."""
    words = ["robot_ident paper --section", str(number)]
    words += [f"--seed {study.seed}"] if study.seed else []
    words += [
        option
        for option, given in (
            ("--quick", study.quick),
            ("--redesign", study.redesigned),
            ("--printed-table", study.printed_table),
        )
        if given
    ]
    return [" ".join(words), *more]


def numbers(values: Iterable[float], form: str = ".1f") -> str:
    """Return numbers with commas between them."""
    return ", ".join(f"{value:{form}}" for value in values)


def power(log10: float) -> str:
    """Return 10^x as a number is printed."""
    exponent = int(np.floor(log10))
    return f"{10.0 ** (log10 - exponent):.2f}e{exponent}"
