"""Production recordings, overridden speeds and late stamps, as a user meets them on the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from production_line import production

from robot_ident.bags import write_recording
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

Run = Callable[..., Any]


@pytest.fixture(scope="module")
def line(arm: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("line") / "line.npz"
    write_recording(path, production(arm.robot, cycles=15, late=2e-3).recording)
    return path


def test_info_counts_cycles_and_says_which_clock(run: Run, line: Path) -> None:
    told = run("info", line)
    assert "14 cycles of 5 moves" in told.out
    assert "the sampling does not" in told.out + told.err
    recording = run("info", line, "--json").json["recording"]
    assert recording["cycles"]["count"] == 14
    assert recording["clock"]["stamps"] == "late"
    assert recording["clock"]["residual_even"] < 0.2 * recording["clock"]["residual_stamped"]


def test_identify_and_diagnose_use_the_cycles(run: Run, line: Path, tmp_path: Path) -> None:
    model = run("identify", line, "-o", tmp_path / "model.yaml", "--json").json
    (taken,) = model["recordings"]
    assert (taken["taken_as"], taken["repeats"], taken["clock"]["stamps"]) == ("cycles", 14, "late")
    assert None not in model["noise"]["torque_variance"]
    assert run("diagnose", tmp_path / "model.yaml", line, "--json").json["verdict"] == "adequate"
    assert run("compare", tmp_path / "model.yaml", line, "--mcap", tmp_path / "beside.mcap").code == 0


def test_a_stretched_motion_is_identified_at_its_own_speed(run: Run, arm: Any, tmp_path: Path) -> None:
    series = arm.series
    Excitation("kuka_ir361", arm.robot.joints, series, 150.0).write(tmp_path / "asked.yaml")
    slow = replace(arm, series=FourierSeries(0.087, series.q0, 0.87 * series.a, 0.87 * series.b))
    write_recording(tmp_path / "slow.npz", slow.record(1, periods=4))
    model = run("identify", tmp_path / "slow.npz", "--trajectory", tmp_path / "asked.yaml", "--json").json
    assert any("at 87 % of the speed" in note for note in model["notes"])
    assert model["processing"]["base_frequency"] == pytest.approx(0.087, rel=1e-4)
    refused = run("identify", tmp_path / "slow.npz", "--base-frequency", "0.1")
    assert refused.code == 2
    assert "at 87 % of its speed" in refused.err
