"""The pages: short enough to be read, and no link that leads nowhere."""

from __future__ import annotations

import re
from pathlib import Path

PAGES = ("README.md", "CONTRIBUTING.md", "docs", "examples")
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|srcset)=\"([^\"]+)\"")


def pages(checkout: Path) -> list[Path]:
    """Return all pages in Markdown."""
    places = [checkout / name for name in PAGES]
    return [page for place in places for page in ([place] if place.is_file() else sorted(place.rglob("*.md")))]


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as they are made from the words."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", page.read_text(), flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings}


def test_the_first_page_is_read_in_minutes(checkout: Path) -> None:
    assert len((checkout / "README.md").read_text(encoding="utf-8").split()) <= 900


def test_every_link_leads_somewhere(checkout: Path) -> None:
    lost = []
    for page in pages(checkout):
        for groups in LINK.findall(page.read_text(encoding="utf-8")):
            target = groups[0] or groups[1]
            if re.match(r"[a-z]+:", target):
                continue
            name, _, anchor = target.partition("#")
            file = (page.parent / name).resolve() if name else page
            if not file.exists() or (anchor and file.suffix == ".md" and anchor not in anchors(file)):
                lost.append(f"{page.relative_to(checkout)}: {target}")
    assert lost == []


def test_every_page_is_found_from_the_index(checkout: Path) -> None:
    index = (checkout / "docs/README.md").read_text(encoding="utf-8")
    assert [page.name for page in sorted((checkout / "docs").glob("*.md")) if f"({page.name}" not in index] == [
        "README.md"
    ]
