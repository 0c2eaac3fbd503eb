"""What the workbench writes where, and that it replaces nothing of anyone else's: by the requests that a page sends."""

from __future__ import annotations

import resource
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.server import make_app

TAKEN = {
    "run.mcap": "recording",
    "run.db3": "recording",
    "run.npz": "recording",
    "RUN.CSV": "recording",
    "bag": "is a folder",
    "bag/metadata.yaml": "bag is a recording",
    "bag/new.yaml": "bag is a recording",
    "theirs.yaml": "not saved by this workbench",
    "named.yaml": "only read",
    "kept/session_1/session.yaml": "sessions are kept there",
    "kept/session_1/step_0/model.yaml": "sessions are kept there",
    "old/session.yaml": "sessions are kept there",
    ".bashrc": "starting with a dot",
    ".git/config": "starting with a dot",
    "shown": "starting with a dot",
    "out.yaml": "outside",
    "link/secret.yaml": "outside",
    "../secret.yaml": "outside",
    "bag/../../secret.yaml": "outside",
}
NEW = {
    "new.mcap": "recording",
    "run.mcap.conditions.yaml": "recording",
    "kept/new.yaml": "sessions are kept there",
    ".new": "starting with a dot",
    "link/new.yaml": "outside",
    "no/such/new.yaml": "does not exist",
    "theirs.yaml/new.yaml": "does not exist",
    "circle/new.yaml": "",
    "x" * 300: "not saved",
    "a\0b": "no path",
    "\ud800.yaml": "not saved",
    " ": "give the file a name",
}


class Page:
    """A page that presses the buttons of one session."""

    def __init__(self, desk: Desk) -> None:
        self.desk = desk
        self._client = make_app(desk, 8050, "token").server.test_client(use_cookies=False)
        self._known = {"Host": "127.0.0.1:8050"}
        answer = self._client.get("/?token=token", headers=self._known)
        self._known["Cookie"] = answer.headers["Set-Cookie"].partition(";")[0]

    def save(self, what: str, name: str, *, replace: bool = True) -> tuple[str, str]:
        """Press a button; return what is said beside it, and what of that is a refusal."""
        every = self._client.get("/_dash-dependencies", headers=self._known).json
        (about,) = [one for one in every if [part["id"] for part in one["inputs"]] == ["pressed"]]
        given = {
            "pressed": {"of": {"do": f"save {what}", "label": "", "at": ""}, "count": 1},
            "stand": {"session": "session_1"},
            "overlays": [],
            "other": None,
            "replace": ["yes"] if replace else [],
        }

        def told(part: dict[str, str]) -> Any:
            if part["id"].startswith("{"):
                value = {"name": what} if part["property"] == "id" else name
                return [{"id": {"name": what}, "property": part["property"], "value": value}]
            return {**part, "value": given[part["id"]]}

        outputs = [one.rpartition(".") for one in about["output"].strip(".").split("...")]
        sent = {
            "output": about["output"],
            "outputs": [{"id": where, "property": what} for where, _, what in outputs],
            "inputs": [told(part) for part in about["inputs"]],
            "state": [told(part) for part in about["state"]],
            "changedPropIds": ["pressed.data"],
        }
        answer = self._client.post("/_dash-update-component", headers=self._known, json=sent)
        assert answer.status_code == 200, answer.text
        said = answer.json["response"]["saved"]["children"]
        refused = "" if isinstance(said, str) else str(said["props"]["children"])
        return (said if isinstance(said, str) else ""), refused


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a folder with all that must not be lost."""
    made = tmp_path / "root"
    for name in ("bag/data.mcap", "run.mcap", "run.db3", "run.npz", "RUN.CSV", ".bashrc", ".git/config", "named.yaml"):
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(f"{name} is precious")
    for name in ("bag/metadata.yaml", "theirs.yaml", "old/session.yaml", "../secret.yaml"):
        (made / name).parent.mkdir(parents=True, exist_ok=True)
        (made / name).write_text(f"{name} is precious")
    (made / "out.yaml").symlink_to(tmp_path / "secret.yaml")
    (made / "link").symlink_to(tmp_path)
    (made / "shown").symlink_to(made / ".bashrc")
    (made / "circle").symlink_to(made / "circle")
    return made


@pytest.fixture
def page(bench: Any, root: Path) -> Iterator[Page]:
    """Return a page on a session that was opened."""
    yield from opened(bench, root, root / "kept")


def opened(bench: Any, root: Path, kept: Path) -> Iterator[Page]:
    shutil.copytree(bench.session.folder, kept / "session_1")
    desk = Desk(kept, Allowed(root, ["named.yaml"]))
    yield Page(desk)
    desk.close()


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder, links not followed, and what they hold."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("what", ["model", "report", "commands"])
def test_nothing_is_replaced_and_nothing_written_elsewhere(page: Page, root: Path, what: str) -> None:
    before = contents(root.parent)
    for name, why in (TAKEN | NEW).items():
        said, refused = page.save(what, name)
        assert said == "", name
        assert why in refused, name
        assert "\n" not in refused
        assert contents(root.parent) == before, name
    assert page.desk.jobs(page.desk.session("session_1")).look().state == "idle", "no report was begun"


def test_what_was_saved_here_may_be_replaced_while_nobody_changed_it(page: Page, root: Path) -> None:
    (root / "deep").mkdir()
    for what, name in (("model", "found.yaml"), ("commands", "deep/again.sh")):
        said, refused = page.save(what, name, replace=False)
        assert (said, refused) == (f"Saved: {name} (step 0)", "")
        assert "tick" in page.save(what, name, replace=False)[1]
        assert page.save(what, name)[0] == f"Saved: {name} (step 0)"
    model = (root / "kept/session_1/step_0/model.yaml").read_text()
    assert (root / "found.yaml").read_text() == model
    (root / "found.yaml").write_text("someone's notes")
    assert "not saved by this workbench" in page.save("model", "found.yaml")[1]
    assert (root / "found.yaml").read_text() == "someone's notes"
    (root / "found.yaml").unlink()
    assert page.save("model", "found.yaml")[0]


@pytest.mark.long
def test_a_report_replaces_a_report_of_ours_and_no_file_that_came_meanwhile(
    page: Page, root: Path, settled: Callable[[Any], Any]
) -> None:
    jobs = page.desk.jobs(page.desk.session("session_1"))
    assert "Writing report.html" in page.save("report", "report.html", replace=False)[0]
    (root / "report.html").write_text("someone else's")
    failed = settled(jobs)
    assert (failed.state, failed.trace) == ("failed", "")
    assert "report.html" in failed.words
    assert (root / "report.html").read_text() == "someone else's"
    assert page.save("report", "mine.html", replace=False)[0]
    assert settled(jobs).words == "The report is written: mine.html"
    assert "tick" in page.save("report", "mine.html", replace=False)[1]
    assert "Writing mine.html" in page.save("report", "mine.html")[0]
    jobs.cancel()


@contextmanager
def full_disk() -> Iterator[None]:
    """Let no file grow beyond some bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("what", ["model", "commands"])
def test_a_full_disk_is_told_beside_the_button(page: Page, root: Path, what: str) -> None:
    assert page.save(what, "found.yaml")[0]
    before = contents(root)
    for name in ("found.yaml", "other.yaml"):
        with full_disk():
            said, refused = page.save(what, name)
        assert said == ""
        assert f"{name} was not saved: " in refused
        assert "make room" in refused
        assert contents(root) == before, "half a file is none, and the one that was there stays"


def test_a_folder_that_nobody_can_write_to_is_told_beside_the_button(bench: Any, tmp_path: Path) -> None:
    for page in opened(bench, Path("/sys"), tmp_path / "kept"):  # not even root writes there
        for what in ("model", "commands"):
            said, refused = page.save(what, "found.yaml")
            assert said == ""
            assert "found.yaml" in refused
            assert "folder" in refused
    assert not Path("/sys/found.yaml").exists()
