"""Pages: whole, safe, and drawn in a real browser with the network off."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.figures.torque_over_time import torque_figure, torque_text
from robot_ident.report.design_sections import provenance_section
from robot_ident.report.page import Plot, Section, render_page, write_page
from robot_ident.report.sections import torque_caption
from robot_ident.residuals.beside import Beside

Open = Callable[..., Any]
Wait = Callable[..., None]

EVIL = "</script><script>document.title = 'caught'</script><img src=x onerror=\"document.title='caught'\">&amp;"


def evil() -> Section:
    """Return a section whose every text wants to be code."""
    from plotly.graph_objects import Figure, Scatter

    from robot_ident.figures.theme import themed

    figure = themed(Figure(Scatter(x=[0, 1], y=[1, 2], name="</script><b>", text=["</script>"] * 2)), height=300)
    return Section(EVIL, "one_plot.html.j2", {"figure": Plot(figure, EVIL, EVIL)})


def test_everything_opens_with_the_network_off(opened: Open, open_once: Open, design_page: Path) -> None:
    for page in (open_once(design_page), opened(design_page, 800, "dark")):
        plots = page.locator(".plot")
        assert plots.count() == 4
        for k in range(4):
            assert plots.nth(k).locator("path.js-line, path.point").count() > 0, "nothing was drawn"
            assert len(plots.nth(k).get_attribute("aria-label")) > 60
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "wider than the window"


def test_the_button_turns_page_and_plots(opened: Open, wait: Wait, design_page: Path) -> None:
    page = opened(design_page)
    colours = "[getComputedStyle(document.body).backgroundColor, document.querySelector('.plot').layout.font.color]"
    light = page.evaluate(colours)
    page.click("#shade")
    wait(page, "document.querySelector('.plot').layout.font.color === '#dfe3e8'")
    dark = page.evaluate(colours)
    assert light == ["rgb(255, 255, 255)", "#1f2328"]
    assert dark == ["rgb(21, 24, 28)", "#dfe3e8"]


def test_zoom_and_legend_work(open_once: Open, wait: Wait, design_page: Path) -> None:
    page = open_once(design_page)
    before = page.evaluate("document.querySelector('.plot').layout.xaxis.range.slice()")
    drag = page.locator(".plot").first.locator("rect.nsewdrag").first.bounding_box()
    page.mouse.move(drag["x"] + 100, drag["y"] + 40)
    page.mouse.down()
    page.mouse.move(drag["x"] + 400, drag["y"] + 45, steps=5)
    page.mouse.up()
    wait(page, f"document.querySelector('.plot').layout.xaxis.range[0] > {before[0]}")
    page.locator(".plot").first.locator(".legendtoggle").first.click()
    wait(page, "document.querySelector('.plot').data[0].visible === 'legendonly'")


@pytest.mark.long
def test_no_button_sends_a_figure_away(opened: Open, press_all: Callable[[Any], list[str]], design_page: Path) -> None:
    page = opened(design_page)
    titles = press_all(page)
    assert "Reset axes" in titles
    assert not [title for title in titles if re.search("share|send|cloud|studio|upload|plotly", title, re.IGNORECASE)]
    assert page.locator(".plotly-cloud-dialog-box, a[href*=plotly]").count() == 0


def test_text_of_users_stays_text(opened: Open, tmp_path: Path) -> None:
    write_page(tmp_path / "evil.html", EVIL, [evil(), provenance_section({EVIL: EVIL})], subtitle=EVIL)
    page = opened(tmp_path / "evil.html")
    assert page.title() == EVIL
    assert page.locator("h1").inner_text() == EVIL
    assert page.locator("figcaption").inner_text() == EVIL
    assert page.locator("main img").count() == 0


def test_it_is_one_file_below_six_megabytes(design_page: Path) -> None:
    text = design_page.read_text(encoding="utf-8")
    assert len(text.encode()) < 6e6
    assert text.count('id="library"') == 1
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", own)
    assert "default-src 'none'" in own


def test_a_page_without_plots_carries_no_library() -> None:
    assert len(render_page("t", [provenance_section({"seed": 1})])) < 30_000


def test_an_existing_page_is_not_replaced(design_page: Path) -> None:
    with pytest.raises(InputError, match="exists already"):
        write_page(design_page, "t", [])


def test_a_million_rows_stay_below_six_megabytes(arm: Any) -> None:
    rng, rows, n = np.random.default_rng(0), 1_000_000, arm.robot.n
    t = np.arange(rows) / 150.0
    measured = rng.normal(size=(rows, n))
    measured[765_432, 1] = 99.0  # one sample that must still be seen
    zero = np.zeros((rows, n))
    used = np.ones((rows, n), dtype=bool)
    found = Beside("long", arm.robot, t, zero, zero, zero, zero, measured, zero, used, np.ones(n), 1.0, 1, None, None)
    figure = torque_figure({"model": found})
    plot = Plot(figure, torque_text({"model": found}), torque_caption("long", found))
    text = render_page("long", [Section("Long", "one_plot.html.j2", {"figure": plot})])
    assert len(text.encode()) < 6e6
    assert "1000000 rows; of each curve the extremes of 1000 stretches of time are drawn" in text
    curve = next(trace for trace in figure.data if trace.name == "measured" and trace.yaxis == "y3")
    assert np.max(curve.y) == pytest.approx(99.0)
