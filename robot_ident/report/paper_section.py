"""A section of the paper's page: what it says, what is found here, the difference, the command that repeats it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from robot_ident.paper.study import Study
from robot_ident.report.page import Plot, Section, Table

NAMES = {"condition": "c1", "d-optimal": "c2"}


def paper_section(
    name: str,
    says: str,
    finds: Sequence[str],
    items: Sequence[Plot | Table],
    difference: str,
    commands: Sequence[str],
) -> Section:
    """Return one section of the paper. says: what is printed; finds: what is found here; items: plots and tables."""
    told = {"says": says, "finds": finds, "items": items, "difference": difference, "commands": commands}
    return Section(name, "paper.html.j2", told)


def as_markdown(title: str, subtitle: str, sections: Sequence[Section]) -> str:
    """Return texts and tables of the page in Markdown, and in words what its figures show."""
    lines = [f"# {title}", "", subtitle]
    for section in sections:
        told = section.context
        lines += ["", f"## {section.title}", "", f"**The paper.** {told['says']}"]
        for number, paragraph in enumerate(told["finds"]):
            lines += ["", f"{'' if number else '**Here.** '}{paragraph}"]
        for item in told["items"]:
            lines += ["", *(_rows(item) if isinstance(item, Table) else [f"*Figure.* {item.caption} {item.text}"])]
        lines += ["", f"**The difference.** {told['difference']}", "", "```sh", *told["commands"], "```"]
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
