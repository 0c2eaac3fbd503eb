"""A real browser, with no network."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robot_ident.design.bound import Bound
from robot_ident.report.design_sections import design_sections
from robot_ident.report.page import write_page

DRAWN = "document.querySelectorAll('.plot').length === document.querySelectorAll('.plot[data-drawn]').length"


def until(page: Any, expression: str, seconds: float = 90.0) -> None:
    """Wait until an expression holds; playwright's own waiting needs the `eval` that our pages forbid."""
    end = time.monotonic() + seconds
    while not page.evaluate(expression):
        assert time.monotonic() < end, f"{expression} did not become true"
        page.wait_for_timeout(50)


@pytest.fixture
def wait() -> Callable[..., None]:
    return until


@contextmanager
def offline(browser: Any) -> Iterator[Callable[..., Any]]:
    """Give a function that opens a file with the network off and waits until all plots are drawn."""
    contexts, problems = [], []

    def note_request(request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:")):
            problems.append(request.url)

    def open_page(path: Path, width: int = 1400, shade: str = "light") -> Any:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=shade, offline=True)
        contexts.append(context)
        context.on("request", note_request)  # of the pages that it opens as well
        page = context.new_page()
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(path.as_uri(), timeout=90_000)  # a loaded machine is slow to start a tab
        until(page, DRAWN)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not problems


@pytest.fixture
def opened(browser: Any) -> Iterator[Callable[..., Any]]:
    """Return a function that opens a file, for one test."""
    with offline(browser) as open_page:
        yield open_page


@pytest.fixture(scope="module")
def open_once(browser: Any) -> Iterator[Callable[[Path], Any]]:
    """Return a function that opens a file, light and wide; the tests of a module look at the same page in turn."""
    with offline(browser) as open_page:
        yield cache(open_page)


@pytest.fixture(scope="session")
def design_page(designed: Any, arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a design's page on disk."""
    path = tmp_path_factory.mktemp("pages") / "design.html"
    units = tuple(parameter.unit for parameter in arm.structure.parameters)
    bound = Bound(-56.1, -55.9, 0.6, 21, 3, 1, 20, 60.0)
    write_page(path, "Excitation of kuka_ir361", design_sections(designed, arm.robot, units, bound))
    return path
