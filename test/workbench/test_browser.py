"""A person at the workbench: real clicks in a real browser, beside what the command line says."""

from __future__ import annotations

import json
import re
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from robot_ident.workbench.server import browsed

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")
PATIENCE = 120_000  # ms: other tests may have the machine to themselves


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Return a function that opens an address; what the console says and where requests go is watched."""
    contexts, problems = [], []

    def go(address: str, width: int = 1400, shade: str = "light") -> Any:
        context = browser.new_context(viewport={"width": width, "height": 1000}, color_scheme=shade)
        contexts.append(context)
        own = re.match(r"http://127\.0\.0\.1:\d+/", address)
        assert own

        def note(request: Any) -> None:
            if not request.url.startswith((own[0], "data:", "blob:")):
                problems.append(request.url)

        context.on("request", note)  # of the pages that it opens as well
        page = context.new_page()
        page.set_default_timeout(PATIENCE)
        page.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(address)
        return page

    yield go
    for context in contexts:
        context.close()
    assert not problems


def rms(mean_square: float) -> str:
    return f"{mean_square**0.5:#.3g}".rstrip(".")


def slow(page: Any, latency: float) -> None:
    """Let every answer come so many ms late: later than the page asks how the work goes."""
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    limits = {"offline": False, "latency": latency, "downloadThroughput": -1, "uploadThroughput": -1}
    session.send("Network.emulateNetworkConditions", limits)


def brush(page: Any, plot: str, number: int, chip: str) -> None:
    """Drag across a picture until it shows; a picture that is being drawn anew lets go of the mouse."""
    late = pytest.importorskip("playwright.sync_api").TimeoutError
    shown = page.locator(".chip").filter(has_text=re.compile(chip))
    for _ in range(5):
        drag(page, plot, number, 0.2, 0.5)
        with suppress(late):
            shown.wait_for(timeout=15_000)
            return
    pytest.fail(f"no region {chip} after five drags")


def drag(page: Any, plot: str, number: int, start: float, end: float) -> None:
    """Drag across a picture, from one share of its width to another."""
    page.locator(plot).scroll_into_view_if_needed()
    box = page.locator(f"{plot} .nsewdrag").nth(number).bounding_box()
    y = box["y"] + 0.5 * box["height"]
    page.mouse.move(box["x"] + start * box["width"], y)
    page.mouse.down()
    for share in (0.3, 0.7, 1.0):
        page.mouse.move(box["x"] + (start + share * (end - start)) * box["width"], y)
    page.mouse.up()


def says(page: Any, selector: str, text: str | re.Pattern[str]) -> str:
    """Wait until a part of the page says something, and return all that it says."""
    page.locator(selector).filter(has_text=text).first.wait_for()
    return str(page.locator(selector).first.inner_text())


def told(session: Path, name: str) -> Any:
    """Return a file of a session; `test_session` holds these to what the command line prints."""
    return json.loads((session / name).read_text())


def test_a_person_finds_and_adds_what_is_missing(serve: Any, visit: Any, recordings: Path, tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    first = serve(recordings, "--bag", "run_1", "run_2", "--validation", "run_3", "--folder", folder)
    page = visit(first.address)
    # see: the worst joint is shown, with the command line's figures
    worst = page.locator("button.joint[aria-pressed=true]")
    worst.wait_for()
    # the token has become a cookie that no script sees
    assert page.url == re.sub(r"\?token=.*", "", first.address)
    assert page.evaluate("document.cookie") == ""
    session = folder / "session_1"
    joints = {one["name"]: one for one in told(session, "step_0/comparison.json")["joints"]}
    name = max(joints, key=lambda one: joints[one]["lack_of_fit"]["statistic"])
    card = worst.inner_text()
    assert name in card
    assert f"residual {rms(joints[name]['residual_mse'])}" in card
    assert "does not fit" in card
    # brush: a sentence, then a picture; all pictures show the same moments
    region = joints[name]["worst"][0]
    page.locator(".sentence").first.click()
    held = says(page, ".held", "of the excess")
    assert held.startswith(f"{100 * region['share']:.0f} % of the excess in {100 * region['of_time']:.0f} %")
    page.locator("#scatter .legendtext", has_text="brushed").wait_for()
    page.get_by_role("button", name="Clear").click()
    page.locator(".held").wait_for(state="detached")
    page.locator("#time .legendtext", has_text="brushed").wait_for(state="detached")
    brush(page, "#time", 1, r"< t < .* s of run_1")
    brush(page, "#scatter", 1, r"< q < .* rad")
    assert page.locator(".chip").count() == 2
    page.get_by_role("button", name="Clear").click()
    # learn, look, add: the next step is always the button beside the words
    following = page.locator("#next button")
    assert following.inner_text() == "Find what is missing"
    following.click()
    said = says(page, "#next", "missing.")
    label = said.split(" ")[0]
    page.locator("#next button", has_text=f"Show what {label} would do").click()
    foreseen = says(page, "#next", "The orange residual")
    page.locator("#time .legendtext", has_text=label).wait_for()
    page.locator("#next button", has_text=f"Add {label}").click()
    done = says(page, "#next", "was added")
    before, after = (told(session, f"step_{k}/errors.json")["validation"][name] for k in (0, 1))
    assert f"on validation from {rms(before)} to {rms(after)}" in done
    predicted = re.search(r"validation, .* from ([\d.]+) to ([\d.]+)", foreseen)
    assert predicted
    assert float(predicted[2]) == pytest.approx(after**0.5, rel=0.05)
    # watch, undo, redo
    page.locator("#staircase .xtick", has_text=label).wait_for()
    page.get_by_role("button", name="Undo").click()
    says(page, "#next", "is missing")
    page.get_by_role("button", name="Redo").click()
    says(page, "#next", "was added")
    # save; a name that is elsewhere, or that of a measurement, is refused beside the button
    measured = sum(path.stat().st_size for path in (recordings / "run_1").iterdir())
    page.get_by_label("replace what was saved here before").check()
    page.get_by_label("Command lines as").fill("run_1")
    page.get_by_role("button", name="Save the command lines").click()
    says(page, "#saved .wrong", "run_1: was named when")
    assert sum(path.stat().st_size for path in (recordings / "run_1").iterdir()) == measured
    page.get_by_label("Model as").fill("../stolen.yaml")
    page.get_by_role("button", name="Save the model").last.click()
    assert "outside" in says(page, "#saved .wrong", "stolen")
    page.get_by_label("Model as").fill("found.yaml")
    page.get_by_role("button", name="Save the model").last.click()
    says(page, "#saved", "Saved: found.yaml")
    assert (recordings / "found.yaml").read_text() == (folder / "session_1/step_1/model.yaml").read_text()
    # the server dies; nothing is lost
    page.close()
    first.process.send_signal(signal.SIGKILL)
    first.process.wait()
    second = serve(recordings, "--folder", folder)
    page = visit(second.address)
    page.get_by_role("link", name="session_1").click()
    assert says(page, "#next", "was added") == done


@pytest.mark.long
def test_a_stranger_chooses_recordings_on_a_narrow_dark_page(
    serve: Any, visit: Any, press_all: Callable[[Any], list[str]], recordings: Path, tmp_path: Path
) -> None:
    served = serve(recordings, "--folder", tmp_path / "kept")
    page = visit(served.address, width=800, shade="dark")
    assert page.locator("html").get_attribute("data-look") == "dark"
    says(page, "#proposed", "run_1 and run_2 for training; run_3 holds a motion of its own, and is kept for validation")
    rows = {name: page.locator(".roles tr", has_text=name) for name in ("run_1", "run_2", "run_3")}
    for name, role in (("run_1", "training"), ("run_2", "training"), ("run_3", "validation")):
        assert rows[name].get_by_label(role).is_checked()
        assert "8 periods of 10 s, 150 Hz" in rows[name].inner_text()
        rows[name].get_by_label("not used").check()
    page.get_by_role("button", name="Open them").click()
    says(page, "#refused", "choose at least one")
    rows["run_1"].get_by_label("training").check()
    page.get_by_role("button", name="Open them").click()
    page.locator("button.joint[aria-pressed=true]").wait_for()
    page.locator("#scatter .scatterlayer").first.wait_for()
    # no button sends a figure away
    titles = press_all(page)
    assert "Reset axes" in titles
    assert not [title for title in titles if re.search("share|send|cloud|studio|upload|plotly", title, re.IGNORECASE)]
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    page.locator("#look").click()
    page.locator("html[data-look=light]").wait_for()
    # one recording, and answers that come late: no click is lost
    slow(page, 700.0)
    page.locator("#next button").click()
    says(page, "#candidates", "one trajectory only")
    box = page.locator(".candidate button.tick:enabled").first
    box.click()
    page.locator(".candidate button.tick[aria-checked=true]").wait_for()
    says(page, "#next", "The orange residual")
    box = page.locator(".candidate button.tick[aria-checked=true]")
    box.focus()
    page.keyboard.press("Space")  # by keyboard as well
    page.locator(".candidate button.tick[aria-checked=true]").wait_for(state="detached")
    other = socket.socket()
    other.settimeout(2.0)
    try:
        outside = next((a[4][0] for a in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)), "127.0.0.1")
        if not outside.startswith("127."):
            with pytest.raises(OSError):
                other.connect((outside, served.port))
    finally:
        other.close()


def test_the_page_that_opens_the_browser_is_for_one_pair_of_eyes(
    serve: Any, browser: Any, recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    served = serve(recordings, "--folder", tmp_path / "kept")
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    with browsed(served.address, tmp_path):
        (link,) = opened
        assert served.address.partition("token=")[2] not in link, "every user of the machine sees a command line"
        (file,) = tmp_path.glob("*.html")
        assert file.as_uri() == link
        assert file.stat().st_mode & 0o077 == 0
        context = browser.new_context()
        try:
            page = context.new_page()
            page.goto(link)
            says(page, "h1", "robot_ident workbench")
            page.wait_for_url(re.compile(r"^http://127\.0\.0\.1:\d+/$"))
        finally:
            context.close()
    assert not file.exists()
