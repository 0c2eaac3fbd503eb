"""Draws the pictures of docs/report.md and docs/workbench.md: report and workbench on the case that the pages describe,
a simulated KUKA whose second joint has 8 % load-dependent friction.

`page_pictures.py [FOLDER]` writes elsewhere. Needs Chromium and playwright. The seeds are fixed.
"""

from __future__ import annotations

import base64
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from robot_ident.cli.main import main

EFFECT = "load_friction@joint_2"
HIDDEN = f"{EFFECT}:0.08"
WIDTHS, SHADES = (1400, 800), ("light", "dark")
PARTS = {
    "report_verdict": ("#verdict", "#measured-and-predicted"),
    "report_where": ("#where-it-fails", "#where-it-fails h3:has-text('By frequency')"),
    "report_frequency": ("#where-it-fails h3:has-text('By frequency')", "#what-is-missing"),
    "report_missing": ("#what-is-missing", "#parameters"),
}
"""Pictures of the report, each from one element of the page to the next."""
MARGIN = 12  # px


def run(*words: object) -> None:
    """Run a command of robot_ident."""
    code = main([str(word) for word in words])
    if code:
        raise SystemExit(f"robot_ident {words[0]} ended with {code}")


def make(folder: Path) -> None:
    """Record three motions, identify without the effect and with it, and write the report."""
    os.chdir(folder)
    for seed in (1, 2, 3):
        run("design", "--seed", seed, "--starts", 4, "--time-limit", 60, "-o", f"excitation_{seed}.yaml")
        run("simulate", f"excitation_{seed}.yaml", "--effect", HIDDEN, "--seed", seed, "-o", f"run_{seed}")
    run("identify", "run_1", "run_2", "-o", "model_1.yaml")
    run("add", "model_1.yaml", EFFECT, "--bag", "run_1", "run_2", "-o", "model_2.yaml")
    bags = ["--bag", "run_1", "run_2", "--validation", "run_3", "--trajectory", "excitation_1.yaml"]
    run("report", "model_1.yaml", "model_2.yaml", *bags, "-o", "report.html")


def shoot(page: Any, file: Path, clip: dict[str, float] | None = None) -> None:
    """Write what a page shows, all of it or a part, as webp."""
    told = {"format": "webp", "quality": 50, "captureBeyondViewport": True}
    size = page.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    area = clip or {"x": 0, "y": 0, "width": size[0], "height": size[1]}
    session = page.context.new_cdp_session(page)
    answer = session.send("Page.captureScreenshot", {**told, "clip": {**area, "scale": 1}})
    file.write_bytes(base64.b64decode(answer["data"]))


def part(page: Any, first: str, after: str) -> dict[str, float]:
    """Return the area from one element of a page to another one."""
    begin, end = (page.locator(one).first.bounding_box() for one in (first, after))
    width = page.locator("main").bounding_box()["width"] + 2 * MARGIN
    return {"x": begin["x"] - MARGIN, "y": begin["y"], "width": width, "height": end["y"] - begin["y"]}


def report(browser: Any, folder: Path) -> None:
    """Take the report at both widths and shades, and the sections that docs/report.md explains."""
    for width in WIDTHS:
        for shade in SHADES:
            page = browser.new_page(viewport={"width": width, "height": 1000}, color_scheme=shade)
            page.goto(Path("report.html").absolute().as_uri())
            page.wait_for_timeout(3000)
            shoot(page, folder / f"report_{width}_{shade}.webp")
            if (width, shade) == (800, "light"):
                for name, ends in PARTS.items():
                    shoot(page, folder / f"{name}.webp", part(page, *ends))


@contextmanager
def workbench() -> Iterator[str]:
    """Serve the workbench on the recordings; yield its address."""
    words = ["workbench", "--bag", "run_1", "run_2", "--validation", "run_3", "--no-browser"]
    with subprocess.Popen(
        [sys.executable, "-m", "robot_ident", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as served:
        assert served.stdout is not None
        try:
            address = next(found[0] for line in served.stdout if (found := re.search(r"http://\S+", line)))
            yield address
        finally:
            served.terminate()


def steps(browser: Any, folder: Path) -> None:
    """Take the workbench with the candidate of the effect laid over the residual."""
    with workbench() as address:
        for width in WIDTHS:
            for shade in SHADES:
                page = browser.new_page(viewport={"width": width, "height": 1000}, color_scheme=shade)
                page.goto(address)
                if (width, shade) == (WIDTHS[0], SHADES[0]):
                    page.get_by_role("button", name="Find what is missing").click(timeout=120_000)
                page.get_by_role("button", name=f"Show what {EFFECT} would do").click(timeout=120_000)
                page.wait_for_timeout(4000)
                shoot(page, folder / f"workbench_{width}_{shade}.webp")


def draw(folder: Path) -> None:
    """Write all pictures."""
    from playwright.sync_api import sync_playwright

    chromium = next(path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name)))
    folder = folder.absolute()
    with TemporaryDirectory() as place, sync_playwright() as playwright:
        make(Path(place))
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        report(browser, folder)
        steps(browser, folder)
        browser.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1] / "docs" / "images")
