"""`design` with a model, earlier recordings, several motions, and two effects to tell apart."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from robot_ident.cli.design import bandwidth_of, output_files
from robot_ident.design import discrimination

Run = Callable[..., Any]

SHORT = ("--base-frequency", 0.25, "--sample-rate", 50, "--harmonics", 3, "--starts", 1)


@pytest.fixture(scope="module")
def model(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from robot_ident.cli.main import main

    path = tmp_path_factory.mktemp("models") / "model.yaml"
    assert main(["identify", str(bag), "-o", str(path)]) == 0
    return path


def test_several_files(run: Run, tmp_path: Path) -> None:
    done = run("design", *SHORT, "--trajectories", 2, "--time-limit", 8, "--json", "-o", tmp_path / "e.yaml")
    assert done.code == 0, done.err
    assert done.json["files"] == [str(tmp_path / "e_1.yaml"), str(tmp_path / "e_2.yaml")]
    assert not (tmp_path / "e.yaml").exists()
    first, second = (yaml.safe_load(Path(file).read_text(encoding="utf-8")) for file in done.json["files"])
    assert first["a"] != second["a"]
    assert first["achieved"]["log10_det_covariance"] == done.json["log10_det_covariance"]
    again = run("design", *SHORT, "--trajectories", 2, "--time-limit", 8, "-o", tmp_path / "e.yaml")
    assert again.code == 2
    assert "e_1.yaml" in again.err


def test_a_model_and_what_recordings_told(run: Run, bag: Path, model: Path, tmp_path: Path) -> None:
    words = ("design", *SHORT, "--time-limit", 4, "--json", "--model", model)
    alone = run(*words)
    beside = run(*words, "--prior", bag, model, "-o", tmp_path / "next.yaml")
    assert alone.code == beside.code == 0, alone.err + beside.err
    assert beside.json["log10_det_covariance"] < alone.json["log10_det_covariance"]
    told = yaml.safe_load((tmp_path / "next.yaml").read_text(encoding="utf-8"))["reproduce"]
    assert told["model"] == str(model)
    assert told["prior"] == [str(bag), str(model)]
    bound = run(*words, "--criterion", "crlb", "--prior", bag)
    assert bound.code == 0, bound.err
    assert bound.json["log10_det_covariance"] < alone.json["log10_det_covariance"]


def test_the_command_that_a_diagnosis_prints_runs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: Path, arm: Any
) -> None:
    monkeypatch.setattr(discrimination, "_RANDOM", 3)
    monkeypatch.setattr(discrimination, "MENU", (("slow", 1),))
    monkeypatch.setattr(discrimination, "_ROUNDS", 0)
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(discrimination.tell_command("stribeck@joint_2", "presliding@joint_2", arm.robot))
    assert program == "robot_ident"
    done = run(*words, "--json")
    assert done.code == 0, done.err
    assert done.json["tell"]["effects"] == ["stribeck@joint_2", "presliding@joint_2"]
    assert done.json["tell"]["noncentrality"] > 0.0
    assert run("check", "tell.yaml").code == 0
    of_model = run("design", "--tell", "cable@joint_2", "end_stop@joint_2", "--robot", model)
    assert of_model.code == 0, of_model.err
    assert "noncentrality" in of_model.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--criterion", "crlb"], "needs a first estimate (--model model.yaml)"),
        (["--bandwidth", "2"], "--bandwidth '2': LO:HI in Hz was expected"),
        (["--bandwidth", "0.11:0.19"], "holds no harmonic"),
        (["--trajectories", "0"], "--trajectories"),
        (["--tell", "stribeck@joint_2", "stribek@joint_2"], "did you mean 'stribeck'"),
        (["--tell", "stribeck@joint_2", "cable@joint_2", "--symmetric"], "--tell chooses its motion's form itself"),
        (["--model", "missing.yaml"], "missing.yaml"),
        (["--prior", "missing_bag"], "missing_bag"),
    ],
)
def test_bad_input(run: Run, words: list[str], message: str) -> None:
    done = run("design", *words)
    assert done.code == 2
    assert message in done.err
    assert "Traceback" not in done.err


def test_what_is_known_counts_once(run: Run, bag: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(bag, copy)
    for other, message in ((bag, f"{bag} is given twice"), (copy, f"{copy} holds the samples of {bag}")):
        done = run("design", *SHORT, "--time-limit", 4, "--prior", bag, other)
        assert done.code == 2
        assert message in done.err


def test_words_of_options() -> None:
    assert bandwidth_of("0.5:2.5") == (0.5, 2.5)
    assert bandwidth_of(None) is None
    assert output_files("a/x.yaml", 3) == ["a/x_1.yaml", "a/x_2.yaml", "a/x_3.yaml"]
    assert output_files("x.yaml", 1) == ["x.yaml"]
    assert output_files(None, 2) == []
