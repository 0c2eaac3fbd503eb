"""Results show themselves in a notebook, every text escaped."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from typing import TYPE_CHECKING

import pytest

from robot_ident.markup import listed, paragraph, table

if TYPE_CHECKING:
    from robot_ident.workflow.findings import Findings

EVIL = "<script>alert(1)</script>&"


class Reader(HTMLParser):
    """Gathers tags, that must be closed in order, and text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        self.tags.add(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def read(html: str) -> Reader:
    reader = Reader()
    reader.feed(html)
    reader.close()
    assert not reader.open
    return reader


def test_text_is_escaped() -> None:
    found = read(table((EVIL,), [(EVIL,), (None,), (0.123456,)], EVIL) + paragraph(EVIL) + listed([EVIL]))
    assert "script" not in found.tags
    assert found.text.count(EVIL) == 5
    assert {"-", "0.1235"} <= set(found.text)


def test_a_model_shows_all_its_parameters(findings: Findings) -> None:
    found = read(replace(findings.last.model, notes=(EVIL,))._repr_html_())
    assert {p.name for p in findings.last.model.parameters} <= set(found.text)
    assert EVIL in found.text


def test_a_comparison_shows_where_it_fails(findings: Findings) -> None:
    found = read(findings.steps[0].comparison._repr_html_())
    assert "does not fit" in found.text
    assert any("speed" in text or "velocity" in text for text in found.text)
    assert "does not fit" not in read(findings.last.comparison._repr_html_()).text


@pytest.mark.parametrize("place", [0, 1])
def test_a_diagnosis_shows_its_verdict_and_candidates(findings: Findings, place: int) -> None:
    diagnosis = findings.diagnoses[place]
    found = read(diagnosis._repr_html_())
    assert found.text[0] == diagnosis.in_words
    assert {s.label for s in (*diagnosis.missing, *diagnosis.others)} <= set(found.text)
