"""`robot_ident simulate --hidden`: a robot with a secret, the same for every motion that it is shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import read_recording
from robot_ident.cli.main import main
from robot_ident.robot import Robot
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.scenario import open_sealed
from robot_ident.trajectories.excitation import Excitation


@pytest.fixture
def excitations(kuka: Robot, tmp_path: Path) -> list[Path]:
    """Return two small excitations of the KUKA as files."""
    paths = []
    for k, series in enumerate(standard_motions(kuka, 2)):
        paths.append(tmp_path / f"excitation_{k}.yaml")
        Excitation(kuka.name, kuka.joints, series, 150.0).write(paths[-1])
    return paths


def simulated(*options: object) -> int:
    return main(["simulate", *(str(option) for option in options), "--periods", "2", "--json"])


def test_the_same_secret_for_every_motion(excitations: list[Path], tmp_path: Path, capsys) -> None:
    for k, path in enumerate(excitations):
        assert simulated(path, "--hidden", 3, "--seed", k, "-o", tmp_path / f"run_{k}") == 0
    printed = [json.loads(part) for part in capsys.readouterr().out.replace("}\n{", "}\0{").split("\0")]
    sealed = [Path(each["sealed"]) for each in printed]
    assert sealed == [tmp_path / "run_0.sealed", tmp_path / "run_1.sealed"]
    assert sealed[0].read_text() == sealed[1].read_text()
    scenario = open_sealed(sealed[0])
    assert open_sealed(tmp_path / "run_0") == scenario, "the bag will do"
    assert scenario.seed == 3
    assert scenario.effects
    for label in scenario.labels:
        assert label not in json.dumps(printed)
    first, second = (read_recording(tmp_path / f"run_{k}") for k in (0, 1))
    assert first.tau.shape == second.tau.shape
    assert np.any(first.tau != second.tau)


def test_what_is_hidden_is_in_the_recording(excitations: list[Path], tmp_path: Path, kuka: Robot) -> None:
    """The torque is that of the sealed effects, given openly, sample by sample: the same seed, the same noise."""
    assert simulated(excitations[0], "--hidden", 3, "-o", tmp_path / "hidden") == 0
    scenario = open_sealed(tmp_path / "hidden.sealed")
    assert {p.label for p in plant_physics(kuka, scenario.effects)} >= set(scenario.labels)
    openly = [word for effect in scenario.all_effects for word in ("--effect", effect)]
    assert simulated(excitations[0], *openly, "-o", tmp_path / "open") == 0
    assert simulated(excitations[0], "-o", tmp_path / "plain") == 0
    hidden, given, plain = (read_recording(tmp_path / name) for name in ("hidden", "open", "plain"))
    np.testing.assert_array_equal(hidden.tau, given.tau)
    assert np.sqrt(np.mean((hidden.tau - plain.tau) ** 2)) > 0.5
    assert not (tmp_path / "open.sealed").exists()


def test_what_cannot_be_hidden_is_refused(excitations: list[Path], tmp_path: Path, capsys) -> None:
    bag = tmp_path / "run"
    assert simulated(excitations[0], "--hidden", 3, "--effect", "cable@joint_1", "-o", bag) == 2
    assert "--hidden and --effect exclude each other" in capsys.readouterr().err
    assert simulated(excitations[0], "--hidden", -3, "-o", bag) == 2
    assert "hidden seed -3" in capsys.readouterr().err
    (tmp_path / "run.sealed").write_text("keep")
    assert simulated(excitations[0], "--hidden", 3, "-o", bag) == 2
    assert "run.sealed exists already" in capsys.readouterr().err
    assert not bag.exists()
