"""`check`: parts of a motion, the approach from a pose, and what can't be certified."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from robot_ident.cli.main import main
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries


@pytest.fixture
def path(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    a, b = 0.1 * rng.normal(size=(2, 3, 5))
    series = FourierSeries(0.1, np.array([0.0, 0.5, 0.5]), a, b)
    excitation = Excitation("kuka_ir361", ("joint_1", "joint_2", "joint_3"), series, 150.0)
    excitation.write(tmp_path / "excitation.yaml")
    return tmp_path / "excitation.yaml"


def test_every_part_is_printed(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(path), "--from=-0.5,0.3,0.9"]) == 0
    out = capsys.readouterr().out
    places = [out.index(f"\n{name}\n") for name in ("blend-in", "blend-out", "approach")]
    assert places == sorted(places)
    assert out.count("acceleration  joint_2") == 4
    assert "every limit is kept" in out


def test_json_holds_every_part(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(path), "--from", "0.1,0.3,0.9", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    for part in ("margins", "played", "blend_in", "blend_out", "approach"):
        assert data[part]["kept"] is True
        assert data[part]["torque"]["joint_1"]["proven"] is True
    played = data["played"]["velocity"]["joint_2"]["margin"]
    parts = [data[part]["velocity"]["joint_2"]["margin"] for part in ("margins", "blend_in", "blend_out")]
    assert played == pytest.approx(min(parts), abs=1e-12)
    assert main(["check", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["approach"] is None


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ("0.1,0.2", "3 numbers were expected, for joint_1, joint_2, joint_3"),
        ("0.1,x,0", "3 numbers were expected"),
        ("0.1,0.2,1.3", "joint_3 at 1.3 rad, its limit is 1.2 rad"),
        ("0,1.19,1.19", "outside the workspace"),
    ],
)
def test_a_start_that_cannot_be(path: Path, start: str, words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(path), "--from", start]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
