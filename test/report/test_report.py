"""The report in a real browser with the network off: plots drawn, zoom and toggles at work, figures as computed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robot_ident.estimation.validation import validate
from robot_ident.report.sections import report_sections, write_report
from robot_ident.workflow.findings import Findings

EVIL = "<img src=x onerror=\"document.title='caught'\"><b>%{x}"
SECTIONS = [
    "Verdict",
    "Error reduction",
    "Measured and predicted",
    "On the validation motion",
    "Where it fails",
    "What is missing",
    "Parameters",
    "Excitation",
    "Provenance",
]


@pytest.fixture(scope="module")
def report(findings: Findings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("reports") / "report.html"
    write_report(path, findings)
    return path


def rows_of(page: Any, anchor: str, table: int = 0) -> list[list[str]]:
    """Return the cells of a table's body."""
    rows = page.locator(f"#{anchor} table").nth(table).locator("tbody tr")
    return [rows.nth(k).locator("td").all_inner_texts() for k in range(rows.count())]


@pytest.mark.parametrize("look", ["wide and light", pytest.param("narrow and dark", marks=pytest.mark.long)])
def test_every_plot_is_drawn_and_told(
    opened: Callable[..., Any], open_once: Callable[[Path], Any], report: Path, look: str
) -> None:
    page = open_once(report) if look == "wide and light" else opened(report, 800, "dark")
    assert page.locator("h2").all_inner_texts() == SECTIONS
    plots = page.locator(".plot")
    assert plots.count() == 9
    for k in range(plots.count()):
        drawn = plots.nth(k).locator("path.js-line, path.point, .points path")
        assert drawn.count() > 0
        assert len(plots.nth(k).get_attribute("aria-label")) > 60
        titles = plots.nth(k).evaluate(
            "p => Object.keys(p._fullLayout).filter(k => /^[xy]axis/.test(k)).map(k => p._fullLayout[k])"
            ".filter(a => a.side === 'left' || a.title.text).map(a => a.title.text || '')"
        )
        assert titles
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), "wider than the window"


def test_a_reader_reads_zooms_and_hides(
    open_once: Callable[[Path], Any], wait: Callable[..., None], report: Path, findings: Findings
) -> None:
    page = open_once(report)
    _verdict_is_that_of_the_core(page, findings)
    words = page.locator("#where-it-fails").inner_text()
    assert "model_1: joint_2" in words
    assert "rad/s" in words
    assert "model_2 fits at every joint" in words
    _zoom_in_one_panel_zooms_all(page, wait)
    _legend_hides_a_model_in_all_panels(page, wait)


def _zoom_in_one_panel_zooms_all(page: Any, wait: Callable[..., None]) -> None:
    plot = page.locator("#measured-and-predicted .plot").first
    plot.scroll_into_view_if_needed()
    drag = plot.locator("rect.nsewdrag").first.bounding_box()
    page.mouse.move(drag["x"] + 200, drag["y"] + 60)
    page.mouse.down()
    page.mouse.move(drag["x"] + 500, drag["y"] + 62, steps=5)
    page.mouse.up()
    read = "p => Object.keys(p._fullLayout).filter(k => /^xaxis/.test(k)).map(k => p._fullLayout[k].range.join())"
    wait(page, "document.querySelector('#measured-and-predicted .plot')._fullLayout.xaxis.range[0] > 0.5")
    assert len(set(plot.evaluate(read))) == 1


def _legend_hides_a_model_in_all_panels(page: Any, wait: Callable[..., None]) -> None:
    plot = page.locator("#where-it-fails .plot").first
    plot.scroll_into_view_if_needed()
    hidden = "p.data.filter(t => t.legendgroup === 'model_1' && t.visible === 'legendonly').length"
    name = plot.locator(".legend .traces", has_text="model_1").first
    name.locator(".legendtoggle").click()
    wait(page, f"((p) => {hidden} === 3)(document.querySelector('#where-it-fails .plot'))")


def _verdict_is_that_of_the_core(page: Any, findings: Findings) -> None:
    first, last = (step.model for step in findings.steps)
    unseen = findings.validation[0].recording
    before, after = (validate(model, unseen).residual["joint_2"] for model in (first, last))
    sentence = page.locator(".verdict").inner_text()
    assert "stribeck@joint_2" in sentence
    assert f"from {before.rms:.3g} to {after.rms:.3g} Nm rms" in sentence
    assert "what is left over is noise" in sentence
    rows = rows_of(page, "error-reduction")
    assert [row[0] for row in rows] == ["model_1"] * 3 + ["model_2"] * 3
    assert float(rows[1][7]) == pytest.approx(before.rms, rel=0.01)
    assert float(rows[4][4]) == pytest.approx(last.residual["joint_2"].rms, rel=0.01)
    assert float(rows[1][3]) ** 2 == pytest.approx(float(rows[1][4]) ** 2 - float(rows[1][5]) ** 2, rel=0.05)
    parameters = rows_of(page, "parameters")
    assert [row[0] for row in parameters] == [p.name for p in last.parameters]
    assert float(parameters[0][2]) == pytest.approx(last.values[0], rel=1e-3)


@pytest.mark.long
def test_without_validation_and_excitation_it_says_so(
    opened: Callable[..., Any], findings: Findings, tmp_path: Path
) -> None:
    steps = (replace(findings.steps[0], validation={}),)
    alone = replace(findings, steps=steps, validation=(), played=(), diagnoses={0: findings.diagnoses[0]})
    write_report(tmp_path / "alone.html", alone)
    page = opened(tmp_path / "alone.html")
    assert "lacks stribeck@joint_2" in page.locator(".verdict").inner_text()
    assert "predicted" in page.locator("#error-reduction table").inner_text()
    assert "None was given" in page.locator("#on-the-validation-motion").inner_text()
    assert "Not known" in page.locator("#excitation").inner_text()
    assert page.locator("pre", has_text="robot_ident add").count() == 1


def test_names_of_files_stay_text(opened: Callable[..., Any], findings: Findings, tmp_path: Path) -> None:
    steps = tuple(replace(step, path=EVIL, name=f"{EVIL}{k}") for k, step in enumerate(findings.steps))
    sources = tuple(replace(source, path=EVIL) for source in findings.training)
    write_report(tmp_path / "evil.html", replace(findings, steps=steps, training=sources, command=EVIL))
    page = opened(tmp_path / "evil.html")
    assert page.title().endswith("model vs. measurement")
    assert page.locator("main img").count() == 0
    assert EVIL in page.locator("#where-it-fails .plot .legend").first.evaluate("e => e.textContent").replace(
        "% {", "%{"
    )


def test_it_is_small(report: Path) -> None:
    assert report.stat().st_size < 4e6


def test_every_plot_has_words_and_units(findings: Findings) -> None:
    from robot_ident.report.page import Plot

    def plots(value: Any) -> list[Plot]:
        if isinstance(value, Plot):
            return [value]
        inner = value.values() if isinstance(value, dict) else value if isinstance(value, (list, tuple)) else []
        return [plot for item in inner for plot in plots(item)]

    found = [plot for section in report_sections(findings) for plot in plots(dict(section.context))]
    assert len(found) == 9
    for plot in found:
        assert any(joint in plot.text or "parameters" in plot.text for joint in findings.robot.joints), plot.text
        titles = [axis.title.text for axis in plot.figure.select_yaxes() if axis.title.text]
        titles += [axis.title.text for axis in plot.figure.select_xaxes() if axis.title.text]
        assert any("[" in title or "sigma" in title for title in titles), titles
