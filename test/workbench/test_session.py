"""Sessions: steps on disk, undone and gone on with, and figures that are the command line's."""

from __future__ import annotations

import html
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plotly.utils import PlotlyJSONEncoder

from robot_ident.bags import read_recording, write_recording
from robot_ident.cli.main import main
from robot_ident.configuration import to_yaml
from robot_ident.errors import InputError
from robot_ident.model.model import Model
from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk
from robot_ident.workbench.jobs import Job, Jobs
from robot_ident.workbench.layout import chooser
from robot_ident.workbench.next_step import next_step
from robot_ident.workbench.panels import candidates, where
from robot_ident.workbench.server import make_app
from robot_ident.workbench.session import Choice, Session, begin, script
from robot_ident.workbench.tasks import Work
from robot_ident.workbench.view import View


def verb(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    capsys.readouterr()
    assert main([str(word) for word in words]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.fixture
def copy(bench: Any, tmp_path: Path) -> Session:
    """A session of one's own, diagnosed already."""
    return Session.open(Path(shutil.copytree(bench.session.folder, tmp_path / "session_1")))


@pytest.mark.long
def test_figures_are_those_of_compare_and_diagnose(
    bench: Any, recordings: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(recordings)
    model = bench.session.model_file(0)
    view = View(bench.session, 0)
    compared = verb(capsys, "compare", model, "run_1", "run_2", "--json")
    for mine, theirs in zip(view.comparison["joints"], compared["joints"], strict=True):
        assert {key: mine[key] for key in theirs} == theirs
    found = verb(capsys, "diagnose", model, "run_1", "run_2", "--validation", "run_3", "--json")
    assert view.diagnosis is not None
    assert view.diagnosis["missing"] == found["missing"] != []
    for mine, theirs in zip(view.diagnosis["candidates"], found["candidates"], strict=True):
        assert {key: mine[key] for key in theirs} == theirs
    first = found["candidates"][0]
    preview = view.previews[view.diagnosis["named"][0]]
    for name in view.joints:
        assert preview["before"][name] == pytest.approx(first["residual_mse_before"][name])
        assert preview["after"][name] == pytest.approx(first["residual_mse_after"][name])
        assert preview["validation_after"][name] == pytest.approx(first["validation_mse_after"][name])


@pytest.mark.long
def test_a_preview_is_drawn_as_it_is_told(bench: Any) -> None:
    view = View(bench.session, 0)
    label = view.diagnosis["named"][0]
    overlay = view.overlay(f"with:{label}")
    for joint, name in enumerate(view.joints):
        used = [view.rows[k].weight[:, joint] > 0 for k in view.training]
        rest = np.concatenate([overlay.residual[k][u, joint] for k, u in zip(view.training, used, strict=True)])
        # columns that depend on the torque are a fixed point away from those of the fit
        assert np.mean(rest**2) == pytest.approx(view.previews[label]["after"][name], rel=1e-4)


def test_a_model_that_is_worse_than_none_says_so_beside_its_misfit(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "bags"
    shutil.copytree(recordings / "run_1", folder / "run_1")
    unseen = read_recording(recordings / "run_2")
    write_recording(folder / "backwards.npz", replace(unseen, tau=unseen.tau * [1.0, -1.0, 1.0]))
    session = Desk(tmp_path / "sessions", Allowed(folder)).open(["run_1"], ["backwards.npz"])
    Work(session).do({"task": "open"}, lambda share, words: None)
    view = View(session, 0)
    monkeypatch.setattr(View, "failing", [])
    assert "worse than none" in next_step(view, Job(), []).words, "also where it leaves noise on what it was fitted to"
    notes = [element.children for element in where(view, 1) if getattr(element, "className", "") == "note"]
    (told,) = (note for note in notes if note.startswith("on backwards.npz the model errs by more than the torque"))
    assert "at joint_2, which takes" in told and "joint_1" not in told


def test_a_model_that_can_t_be_used_says_so_first(
    recordings: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Model, "trouble", "not usable: it misses more than half of joint_2")
    session = Desk(tmp_path / "sessions", Allowed(recordings)).open(["run_1"], [])
    Work(session).do({"task": "open"}, lambda share, words: None)
    view = View(session, 0)
    assert next_step(view, Job(), []).words.startswith("Not usable: it misses more than half of joint_2. ")
    assert candidates(view, [], running=False)[0].children == where(view, 1)[0].children == view.trouble


def test_the_command_lines_give_the_same_model(
    bench: Any, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from robot_ident.model.model import Model

    view = View(bench.session, 0)
    label = view.diagnosis["named"][0]
    bench.do("add", number=0, label=label, new=1)
    lines = script(bench.session, 1)
    monkeypatch.chdir(tmp_path)
    for name in ("run_1", "run_2", "run_3"):
        (tmp_path / name).symlink_to(recordings / name)
    identify, add = (
        line.split()[1:] for line in lines.splitlines() if line.startswith(("robot_ident identify", "robot_ident add"))
    )
    assert main(identify) == 0
    added = verb(capsys, *add, "--json")
    mine, theirs = Model.read(bench.session.model_file(1)), Model.read(tmp_path / "model_step_1.yaml")
    np.testing.assert_allclose(mine.values, theirs.values, rtol=1e-9)
    assert mine.provenance["added"] == [label]
    assert View(bench.session, 1).errors["validation"] == pytest.approx(added["validation_mse_after"])
    assert View(bench.session, 0).errors["validation"] == pytest.approx(added["validation_mse_before"])


@pytest.mark.long
def test_a_foreign_session_runs_no_code_that_the_command_line_did_not_name(
    copy: Session, recordings: Path, tmp_path: Path, settled: Any
) -> None:
    evil, ran = tmp_path / "evil.py", tmp_path / "ran"
    evil.write_text(f"open({str(ran)!r}, 'a').close()\n")
    file = copy.folder / "session.yaml"
    for named in (str(evil), "evil.py", f"link/../{evil.name}"):
        foreign = copy.choice.model_copy(update={"folder": str(tmp_path), "effects_from": [named]})
        file.write_text(to_yaml(foreign.model_dump(by_alias=True)))
        desk = Desk(tmp_path, Allowed(recordings), effects_from=[str(tmp_path / "other.py")])
        with pytest.raises(InputError, match="--effects-from") as refused:
            desk.session(copy.name)
        command = f"robot_ident workbench --effects-from {evil} --folder {tmp_path}"
        assert str(refused.value).endswith(command)
        page = make_app(desk, 8050, "token").server.test_client(use_cookies=False)
        known = {"Host": "127.0.0.1:8050", "Cookie": "robot_ident_workbench_8050=token"}
        assert command in html.unescape(page.get(f"/_now/{copy.name}", headers=known).text)
        jobs = Jobs(copy.folder)
        jobs.start({"task": "open"})  # also where the file was changed after it had been looked at
        failed = settled(jobs)
        jobs.close()
        assert (failed.state, failed.trace) == ("failed", "")
        assert command in failed.words
        assert not ran.exists()
    desk = Desk(tmp_path, Allowed(recordings), effects_from=[str(evil)])
    jobs = desk.jobs(desk.session(copy.name))
    jobs.start({"task": "open"})
    settled(jobs)
    desk.close()
    assert ran.exists(), "what the command line names is used"


def test_a_foreign_session_leads_nothing_elsewhere(copy: Session, recordings: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (copy.folder / "step_7").symlink_to(tmp_path / "elsewhere")
    desk = Desk(tmp_path, Allowed(recordings))
    with pytest.raises(InputError, match="holds the link step_7"):
        desk.session(copy.name)
    with pytest.raises(InputError, match="holds the link step_7"):
        desk.open(copy.choice.recordings, copy.choice.validation)


def test_an_unreadable_session_is_named_beside_the_others(copy: Session, recordings: Path) -> None:
    broken = copy.folder.with_name("session_9")
    broken.mkdir()
    (broken / "session.yaml").write_bytes(b"\xff: [")
    desk = Desk(copy.folder.parent, Allowed(recordings))
    opened, refused = desk.sessions
    assert [one.name for one in opened] == [copy.name]
    assert len(refused) == 1 and "session_9" in refused[0]
    words = json.dumps(chooser(desk), cls=PlotlyJSONEncoder)
    assert "session_9" in words and copy.name in words


def test_efforts_that_are_none_of_the_motion_make_no_model(recordings: Path, tmp_path: Path) -> None:
    for name in ("run_1", "run_2"):
        read = read_recording(recordings / name)
        noise = np.random.default_rng(4).normal(size=read.tau.shape) * read.tau.std(axis=0)
        write_recording(tmp_path / f"{name}.npz", replace(read, tau=noise))
    session = Desk(tmp_path / "sessions", Allowed(tmp_path)).open(("run_1.npz", "run_2.npz"), [])
    with pytest.raises(InputError, match="not made by the motion"):
        Work(session).do({"task": "open"}, lambda share, words: None)
    assert not session.steps


def test_undo_redo_and_alternatives(copy: Session) -> None:
    for number, (parent, label) in enumerate([(0, "cable@joint_3"), (1, "time_delay@joint_3"), (0, "base_tilt")], 1):
        folder = copy.step_folder(number)
        if not folder.exists():
            shutil.copytree(copy.step_folder(0), folder)
        (folder / "step.yaml").write_text(f"parent: {parent}\nadded: {label}\nmade: now\n")
    copy.go(2)
    assert copy.added(2) == ["cable@joint_3", "time_delay@joint_3"]
    copy.undo()
    copy.undo()
    assert copy.here == 0
    with pytest.raises(InputError, match="nothing to undo"):
        copy.undo()
    copy.redo()
    copy.redo()
    assert Session.open(copy.folder).here == 2
    copy.go(3)
    copy.undo()
    assert copy.can_redo
    copy.redo()
    assert (copy.here, copy.find(0, "base_tilt")) == (3, 3)
    with pytest.raises(InputError, match="no step 9"):
        copy.go(9)


def test_half_a_step_is_no_step(copy: Session) -> None:
    draft = copy.folder / ".step_1.k3j"
    (draft / "step_1").mkdir(parents=True)
    (draft / "step_1" / "model.yaml").write_text("half")
    before = set(copy.steps)
    assert set(Session.open(copy.folder).steps) == before
    copy.sweep()
    assert not draft.exists()


def test_the_same_choice_is_gone_on_with(recordings: Path, tmp_path: Path) -> None:
    def choice(**more: Any) -> Choice:
        return Choice(folder=str(recordings), recordings=["run_1"], **more)

    first = begin(tmp_path, choice())
    assert begin(tmp_path, choice()).folder == first.folder
    assert begin(tmp_path, choice(validation=["run_3"])).folder != first.folder
    with pytest.raises(InputError, match="training and for validation"):
        begin(tmp_path, choice(validation=["run_1"]))
    with pytest.raises(InputError, match="run_9: there is no such"):
        begin(tmp_path, Choice(folder=str(recordings), recordings=["run_9"]))


def test_work_can_be_cancelled_and_a_lost_process_is_told(desk: Desk, settled: Any) -> None:
    session = desk.open(["run_1"])
    jobs = desk.jobs(session)
    with pytest.raises(InputError, match="computed already"):
        jobs.start({"task": "open"})
    jobs.cancel()
    assert jobs.look().state == "cancelled"
    assert session.steps == {}
    jobs.start({"task": "open"})
    assert settled(jobs).state == "done"
    assert set(session.steps) == {0}
    jobs.start({"task": "preview", "number": 0, "label": "stribek@joint_2"})
    refused = settled(jobs)
    assert (refused.state, refused.trace) == ("failed", "")
    assert "did you mean 'stribeck'" in refused.words
    jobs.start({"task": "diagnose", "number": 0})
    jobs._process.kill()
    assert "ended unexpectedly" in settled(jobs).words
    jobs.start({"task": "preview", "number": 0, "label": "cable@joint_3"})
    assert settled(jobs).state == "done"
