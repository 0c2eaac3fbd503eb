"""Where a model misses most of a joint's torque, `compare` names what the data are: turned, scaled, late, exchanged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident import identify
from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.estimation.prediction import measured_for
from robot_ident.model.model import Model
from robot_ident.model.model_file import write_model
from robot_ident.residuals.likely_reason import likely_reason


@pytest.fixture(scope="module")
def recording(arm: Any) -> Any:
    return arm.record(1, periods=3, lead=0.0)


@pytest.fixture(scope="module")
def model(arm: Any, recording: Any) -> Model:
    return identify([recording], arm.robot)


def reason(model: Model, recording: Any) -> str | None:
    return likely_reason(model, [measured_for(model, recording)])


def test_a_model_that_follows_needs_none(model: Model, recording: Any) -> None:
    assert reason(model, recording) is None
    noisy = np.random.default_rng(1).normal(size=recording.tau.shape) * 0.2 * recording.tau.std(axis=0)
    assert reason(model, replace(recording, tau=recording.tau + noisy)) is None


def test_what_the_declaration_tells(model: Model, recording: Any) -> None:
    told = reason(model, replace(recording, tau=recording.tau * [1.0, -1.0, 1.0]))
    assert told is not None
    assert "joints.joint_2.effort.sign is 1" in told and "change it to" in told
    told = reason(model, replace(recording, tau=np.abs(recording.tau)))
    assert told is not None
    assert "absolute values" in told
    told = reason(model, replace(recording, tau=recording.tau / 1000.0))
    assert told is not None
    assert "effort" in told


def test_what_the_model_alone_tells(model: Model, recording: Any) -> None:
    """A gain that wrong masses might make, an offset, and a delay: the URDF says nothing of them."""
    told = reason(model, replace(recording, tau=recording.tau * [1.0, 1.0, 2.5]))
    assert told is not None
    assert "the effort of joint_3 is 2.5 times the model's (another unit or gain)" in told
    step = 1.5 * np.sqrt(np.mean(recording.tau[:, 2] ** 2))
    told = reason(model, replace(recording, tau=recording.tau + [0.0, 0.0, step]))
    assert told is not None
    assert "joint_3 stands" in told and "an offset" in told


def test_a_late_effort(model: Model, recording: Any) -> None:
    step = float(np.median(np.diff(recording.t)))
    lag = round(0.12 / step)
    told = reason(model, replace(recording, tau=np.roll(recording.tau, lag, axis=0)))
    assert told is not None
    assert f"comes {lag * step * 1e3:.0f} ms late" in told


def test_compare_says_it_first(
    model: Model, recording: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_model(model, tmp_path / "model.yaml")
    write_recording(tmp_path / "right.npz", recording)
    write_recording(tmp_path / "wrong.npz", replace(recording, tau=recording.tau * [1.0, 1.0, -1.0]))
    assert main(["compare", str(tmp_path / "model.yaml"), str(tmp_path / "wrong.npz")]) == 0
    first = capsys.readouterr().err.splitlines()[0]
    assert "likely reason: " in first and "joint_3" in first
    for name, expected in (("wrong", True), ("right", False)):
        assert main(["compare", str(tmp_path / "model.yaml"), str(tmp_path / f"{name}.npz"), "--json"]) == 0
        assert (json.loads(capsys.readouterr().out)["likely_reason"] is not None) == expected
