"""Every verb as scripts use it: JSON keys, exit codes, files whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.cli.main import VERBS

Run = Callable[..., Any]


def test_help_lists_every_verb_without_heavy_imports() -> None:
    code = (
        "import sys\nfrom robot_ident.cli.main import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'casadi', 'pinocchio', 'scipy', 'rclpy', 'mcap', 'pydantic'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    for verb in VERBS:
        assert verb in done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(run: Run, verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        run(verb, "--help")
    assert ended.value.code == 0
    assert "usage: robot_ident" in capsys.readouterr().out


def test_identify_and_validate_keep_the_contract(run: Run, bag: Path, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    done = run("identify", bag, "-o", model, "--json")
    assert done.code == 0, done.err
    data = done.json
    assert data["schema"] == "robot_ident/model/1"
    assert [p["name"] for p in data["parameters"]][:15] == [f"p{k}" for k in range(1, 16)]
    assert len(data["parameters"]) == 21
    assert set(data["parameters"][0]) >= {"name", "value", "std", "unit", "joint", "effect"}
    assert data["noise"]["periods"] == 4
    assert data["noise"]["samples_per_period"] == 1500
    assert set(data["residual"]["joint_1"]) == {"mse", "rms", "noise_variance", "relative"}
    assert isinstance(data["condition_number"], float)
    assert isinstance(data["log10_det_covariance"], float)
    written = yaml.safe_load(model.read_text())
    assert {key: written[key] for key in ("schema", "robot", "estimator", "effects", "parameters")} == {
        key: data[key] for key in ("schema", "robot", "estimator", "effects", "parameters")
    }
    assert written["provenance"]["recordings"][0]["sha256"]
    result = run("validate", model, bag, "--json")
    assert result.code == 0, result.err
    assert result.json["schema"] == "robot_ident/validation/1"
    assert result.json["low_pass_hz"] == 10.0
    assert set(result.json["residual"]["joint_2"]) == {"mse", "rms", "noise_variance", "relative"}
    assert run("validate", model, bag, "--max-rms", "0.001").code == 3
    narrow = tmp_path / "narrow.yaml"
    assert run("identify", bag, "--low-pass", 3, "-o", narrow).code == 0
    assert run("validate", narrow, bag, "--json").json["low_pass_hz"] == 3.0
    assert run("validate", narrow, bag, "--low-pass", 8, "--json").json["low_pass_hz"] == 8.0
    again = run("identify", bag, "-o", model)
    assert again.code == 2
    assert "--force" in again.err
    assert run("identify", bag, "-o", model, "--force").code == 0


def test_effects_become_parameters(run: Run, bag: Path) -> None:
    data = run("identify", bag, "--effect", "torque_offset@joint_2", "--json").json
    assert data["parameters"][-1]["name"] == "torque_offset@joint_2"
    assert data["parameters"][-1]["joint"] == "joint_2"


def test_simulate_check_info_montecarlo(run: Run, excitation: Path, tmp_path: Path) -> None:
    checked = run("check", excitation, "--json")
    assert checked.code == 0, checked.err
    assert checked.json["kept"] is True
    out = tmp_path / "sim"
    done = run("simulate", excitation, "--periods", 4, "--seed", 3, "-o", out, "--json")
    assert done.code == 0, done.err
    assert done.json["samples"] == 7500
    info = run("info", out, "--json").json
    assert info["recording"]["periods"] == 4
    assert info["recording"]["period"] == pytest.approx(10.0)
    model = run("identify", out, "--trajectory", excitation, "--json").json
    assert model["noise"]["periods"] == 4
    trial = run("montecarlo", excitation, "--runs", 50, "--json").json
    assert trial["schema"] == "robot_ident/montecarlo/1"
    assert trial["holds"] is True


def test_a_robot_without_noise_variances_is_said_to_be_simulated_without(
    run: Run, excitation: Path, tmp_path: Path
) -> None:
    robots = Path(__file__).parents[2] / "config" / "robots"
    text = (robots / "kuka_ir361.yaml").read_text().replace("torque_variance: 416, ", "")
    (tmp_path / "mine.yaml").write_text(text.replace("urdf: ", f"urdf: {robots}/"))
    words = (excitation, "--robot", tmp_path / "mine.yaml")
    out = tmp_path / "bag"
    (note,) = run("simulate", *words, "--periods", 1, "-o", out, "--json").json["notes"]
    assert note.startswith("no torque noise on joint_2: ")
    refused = run("montecarlo", *words, "--runs", 2)
    assert refused.code == 2
    assert "the torque noise of joint_2 is unknown" in refused.err


def test_same_seed_same_recording(run: Run, excitation: Path, tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        assert run("simulate", excitation, "--periods", 2, "--seed", 5, "-o", tmp_path / name).code == 0
    a, b = np.load(tmp_path / "a.npz"), np.load(tmp_path / "b.npz")
    np.testing.assert_array_equal(a["tau"], b["tau"])


def test_design_is_certified_and_reproducible(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "e.yaml"
    done = run("design", "--starts", 1, "--time-limit", 20, "--seed", 1, "-o", out, "--json")
    assert done.code == 0, done.err
    data = done.json
    assert data["schema"] == "robot_ident/design/1"
    assert data["files"] == [str(out)]
    assert set(data) >= {"log10_det_covariance", "condition_number", "seconds", "margins"}
    assert run("check", out).code == 0
    file = yaml.safe_load(out.read_text())
    assert file["schema"] == "robot_ident/excitation/1"
    assert set(file) >= {"robot", "joints", "base_frequency", "sample_rate", "harmonics", "q0", "a", "b", "achieved"}


def test_check_names_the_violated_limit(run: Run, excitation: Path, tmp_path: Path) -> None:
    file = yaml.safe_load(excitation.read_text())
    file["a"][1][0] = 3.0
    broken = tmp_path / "broken.yaml"
    broken.write_text(yaml.safe_dump(file))
    done = run("check", broken)
    assert done.code == 3
    assert "joint_2" in done.err
    assert len(done.err.strip().splitlines()) == 1


def test_effects_catalogue(run: Run) -> None:
    listed = run("effects", "--json").json
    assert {"viscous", "coulomb", "torque_offset"} <= {effect["name"] for effect in listed["effects"]}
    assert run("effects", "viscous").code == 0
    assert run("effects", "viscos").code == 2


def test_recover_makes_a_whole_bag(run: Run, bag: Path, tmp_path: Path) -> None:
    (file,) = bag.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(file.read_bytes()[: file.stat().st_size * 3 // 4])
    done = run("recover", cut, "-o", tmp_path / "whole", "--json")
    assert done.code == 0, done.err
    assert done.json["messages"] > 1000
    assert done.json["lost"]
    assert run("info", tmp_path / "whole").code == 0


def test_installed_script_is_quick_to_refuse() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "robot_ident", "identify", "no_such_bag"],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2
    assert "no_such_bag" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_effect_on_every_joint_is_named_by_a_star(run: Run, excitation: Path, bag: Path, tmp_path: Path) -> None:
    words = "simulate", excitation, "--periods", 2, "--effect", "torque_offset@*:2", "-o", tmp_path / "one.npz"
    told = run(*words)
    assert told.code == 0, told.err
    assert [f"with torque_offset@joint_{k}: torque_offset 2 Nm" in told.out for k in (1, 2, 3)] == [True] * 3
    model = tmp_path / "model.yaml"
    assert run("identify", bag, "--effect", "torque_offset@*", "-o", model).code == 0
    added = run("add", model, "torque_scale@*", "--bag", bag, "--json").json
    assert added["added"] == ["torque_scale@joint_2", "torque_scale@joint_3"]
    assert added["notes"] == ["torque_scale@joint_1 is left out: this joint is the reference of the others"]
    assert "torque_scale@joint_1 is left out" in run("add", model, "torque_scale@*", "--bag", bag).err
