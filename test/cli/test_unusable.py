"""A model that is worse than none, or that no arm can have, is told in words wherever it is judged or handed on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from production_line import production

from robot_ident.bags import write_recording
from robot_ident.estimation.identify import identify
from robot_ident.model.model import IMPOSSIBLE
from robot_ident.model.model_file import read_model, write_model
from robot_ident.trajectories.point_to_point import PointToPoint

Run = Callable[..., Any]
LINE = "on backwards.npz the model errs by more than the torque itself, rms"


@pytest.fixture(scope="module")
def model(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("models") / "model.yaml"
    write_model(identify([arm.record(1, periods=4)], arm.robot), path)
    return path


@pytest.fixture(scope="module")
def impossible(model: Path) -> Path:
    """The model with a first axis of negative inertia."""
    found = read_model(model)
    values = np.array(found.values)
    values[found.structure.names.index("p1")] = -9553.0
    write_model(replace(found, values=values), model.with_name("impossible.yaml"))
    return model.with_name("impossible.yaml")


@pytest.fixture(scope="module")
def backwards(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose first joint takes the opposite torque: the model errs by twice what it is."""
    path = tmp_path_factory.mktemp("unseen") / "backwards.npz"
    unseen = arm.record(2, periods=3)
    write_recording(path, replace(unseen, tau=unseen.tau * [-1.0, 1.0, 1.0]))
    return path


def test_validation_says_it_and_keeps_its_exit_code(run: Run, model: Path, bag: Path, backwards: Path) -> None:
    told = run("validate", model, backwards)
    assert told.code == 0
    (line,) = (line for line in told.err.splitlines() if line.startswith(LINE))
    assert "at joint_1, which takes" in line
    assert "joint_2" not in line
    assert line.endswith("identify with backwards.npz too, or with --physical")
    assert run("validate", model, backwards, "--json").json["notes"][-1] == line
    assert "errs by more" not in run("validate", model, bag).err
    assert run("validate", model, backwards, "--max-rms", 1).code == 3


def test_diagnose_and_add_say_it(run: Run, model: Path, bag: Path, backwards: Path) -> None:
    assert LINE in run("diagnose", model, bag, "--validation", backwards).err
    added = run("add", model, "stribeck@joint_2", "--bag", bag, "--validation", backwards, "--json").json
    (note,) = added["notes"]
    assert note.startswith(LINE)
    assert run("add", model, "stribeck@joint_2", "--bag", bag, "--json").json["notes"] == []


def test_the_report_s_sentence_says_it(run: Run, model: Path, bag: Path, backwards: Path, tmp_path: Path) -> None:
    words = "report", model, "--bag", bag, "--validation", backwards, "-o", tmp_path / "page.html", "--json"
    told = run(*words).json
    assert LINE in told["sentence"]
    assert told["notes"][0].startswith(LINE)


def test_no_c_of_what_no_arm_can_be(run: Run, impossible: Path, tmp_path: Path) -> None:
    refused = run("export", impossible, "--c", tmp_path / "code")
    assert refused.code == 2
    assert "no links can have the parameters of this model" in refused.err
    assert "--physical" in refused.err
    assert "--anyway" in refused.err
    assert not (tmp_path / "code").exists()
    done = run("export", impossible, "--c", tmp_path / "code", "--anyway")
    assert done.code == 0
    assert "no links can have the parameters of this model" in done.err
    assert run("export", impossible, "--urdf", tmp_path / "arm.urdf", "--anyway").code == 2


def test_c_of_what_its_uncertainty_lets_be_possible(run: Run, model: Path, tmp_path: Path) -> None:
    """A Coulomb friction two standard deviations below zero does a torque no harm; URDF and MJCF can't hold it."""
    found = read_model(model)
    values, place = np.array(found.values), found.structure.names.index("coulomb@joint_2")
    values[place] = -2.0 * float(np.sqrt(found.covariance[place, place]))
    write_model(replace(found, values=values), tmp_path / "doubtful.yaml")
    done = run("export", tmp_path / "doubtful.yaml", "--c", tmp_path / "code")
    assert done.code == 0
    assert "standard deviations from some that can" in done.err


@pytest.mark.parametrize(("form", "name"), [("--c", "code"), ("--urdf", "arm.urdf"), ("--mjcf", "arm.xml")])
def test_export_measures_the_error_before_it_writes(  # noqa: PLR0913
    run: Run, model: Path, bag: Path, backwards: Path, tmp_path: Path, form: str, name: str
) -> None:
    refused = run("export", model, form, tmp_path / name, "--validation", backwards)
    assert refused.code == 2
    assert LINE in refused.err
    assert not (tmp_path / name).exists()
    assert run("export", model, form, tmp_path / name, "--validation", backwards, "--anyway").code == 0
    done = run("export", model, form, tmp_path / name, "--validation", bag, "--force", "--json").json
    assert set(done["residual"]) == {"joint_1", "joint_2", "joint_3"}
    assert done["residual"]["joint_1"]["mse"] < 3.0 * done["residual"]["joint_1"]["noise_variance"]
    assert run("export", model, form, tmp_path / name, "--force", "--json").json["residual"] is None


def test_validation_takes_the_cycles_that_info_finds(run: Run, arm: Any, model: Path, tmp_path: Path) -> None:
    write_recording(tmp_path / "line.npz", production(arm.robot, cycles=8).recording)
    count = run("info", tmp_path / "line.npz", "--json").json["recording"]["cycles"]["count"]
    found = run("validate", model, tmp_path / "line.npz", "--json").json
    assert any(note.startswith(f"{count} cycles of 5 moves") for note in found["notes"])
    for one in found["residual"].values():
        assert one["mse"] / one["noise_variance"] == pytest.approx(1.0, abs=0.8)


def test_the_band_is_as_wide_as_its_parts(run: Run, model: Path, bag: Path, tmp_path: Path) -> None:
    joints = run("predict", model, bag, "-o", tmp_path / "out.npz", "--json").json["joints"]
    for one in joints.values():
        assert one["band_rms"] == pytest.approx(1.96 * np.hypot(one["std_rms"], one["misfit_rms"]), rel=1e-6)


def test_motions_that_last_for_days_are_refused(run: Run, arm: Any, model: Path, tmp_path: Path) -> None:
    crawl = PointToPoint("kuka_ir361", arm.robot.joints, np.eye(2, 3), np.full(3, 1e-6), np.ones(3))
    crawl.write(tmp_path / "crawl.yaml")
    told = run("predict", model, tmp_path / "crawl.yaml", "-o", tmp_path / "out.csv")
    assert told.code == 2
    assert "it would take 278 hours" in told.err
    slow = PointToPoint("kuka_ir361", arm.robot.joints, np.eye(2, 3), np.full(3, 1.25e-5), np.ones(3))
    slow.write(tmp_path / "slow.yaml")
    told = run("predict", model, tmp_path / "slow.yaml", "-o", tmp_path / "out.csv")
    assert told.code == 2
    assert "a motion of 8e+04 s at 150 Hz is too long" in told.err
    told = run("simulate", tmp_path / "slow.yaml", "-o", tmp_path / "out")
    assert told.code == 2
    assert "too long to simulate" in told.err


@pytest.fixture(scope="module")
def wrong(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with a joint whose effort has nothing to do with its motion."""
    fine = arm.record(3, periods=3)
    wander = np.random.default_rng(1).normal(size=len(fine.t)).cumsum()
    tau = np.column_stack([fine.tau[:, :2], 50.0 * wander / wander.std()])
    path = tmp_path_factory.mktemp("wrong") / "wrong.npz"
    write_recording(path, replace(fine, tau=tau))
    return path


@pytest.mark.long
def test_a_model_that_misses_its_own_torque_says_so_first_in_every_command(
    run: Run, wrong: Path, bag: Path, tmp_path: Path
) -> None:
    """On standard error where the verdict follows, else as the first line of what is printed; in --json as a note."""
    model, folder = tmp_path / "bad.yaml", tmp_path
    assert run("identify", wrong, "--as-declared", "--not-periodic", "-o", model).code == 0
    page, planned, fine = folder / "page.html", folder / "moves.yaml", tmp_path / "fine.yaml"
    assert run("identify", bag, "-o", fine).code == 0
    assert run("design", "--validation-motion", "-o", planned).code == 0
    first = {
        "diagnose": ("diagnose", model, wrong),
        "validate": ("validate", model, bag),
        "predict": ("predict", model, bag, "-o", folder / "out.npz", "--force"),
        "predict a plan": ("predict", model, planned, "-o", folder / "out.npz", "--force"),
        "add": ("add", model, "torque_offset@joint_2", "--bag", wrong),
        "report": ("report", model, "--bag", wrong, "-o", page, "--force"),
    }
    for name, words in first.items():
        told = run(*words)
        assert told.code == 0, name
        line = (told.out if name == "report" else told.err).splitlines()[0]
        assert line.lower().startswith("not usable: on the recordings that it was fitted to"), name
        assert "joint_3" in line, name
        found = run(*words, "--json").json
        assert found["notes"][0].startswith("not usable: "), name
        assert sum(note.startswith("not usable: ") for note in found["notes"]) == 1, name
    assert found["sentence"].startswith("Not usable: ")
    assert '<p class="verdict">Not usable: ' in page.read_text(encoding="utf-8")
    assert "not usable" not in run("diagnose", model, wrong).out, "it is told once"
    compared = run("compare", model, model, wrong).err.splitlines()
    assert "not usable" in compared[0] and "not usable" in compared[1]
    assert "not usable" in run("compare", model, fine).err.splitlines()[0], "without a recording too"


def test_a_model_that_misses_its_own_torque_says_so_first_and_is_not_exported(
    run: Run, wrong: Path, tmp_path: Path
) -> None:
    """A joint whose effort has nothing to do with its motion, gone on with as declared."""
    model = tmp_path / "model.yaml"
    made = run("identify", wrong, "--as-declared", "--not-periodic", "-o", model)
    assert made.code == 0
    first = made.err.splitlines()[0]
    assert "not usable: on the recordings that it was fitted to" in first and "joint_3" in first
    assert "joint_1" not in first
    for option, target in (("--c", tmp_path / "code"), ("--urdf", tmp_path / "arm.urdf")):
        refused = run("export", model, option, target)
        assert refused.code == 2 and "not usable" in refused.err and "--anyway" in refused.err
        assert not target.exists()
    assert "not usable" in run("compare", model, wrong).err.splitlines()[0]


def test_base_parameters_that_no_arm_has_make_a_model_unusable(
    run: Run, model: Path, bag: Path, tmp_path: Path
) -> None:
    """As the note of `identify` says it, which the file keeps."""
    line = f"{IMPOSSIBLE} p2 = 1603 ± 60 kg m, whose torque would be 40 times that of joint_2"
    path, found = tmp_path / "absurd.yaml", read_model(model)
    write_model(replace(found, notes=replace(found, notes=(*found.notes, line)).leading(found.notes)), path)
    assert read_model(path).notes[0] == read_model(path).trouble == f"not usable: {line}"
    assert run("validate", path, bag).err.splitlines()[0] == f"not usable: {line}"
    refused = run("export", path, "--c", tmp_path / "code")
    assert refused.code == 2 and line in refused.err and "--anyway" in refused.err
    assert found.trouble is None
