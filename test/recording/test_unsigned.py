"""Absolute efforts get the sign of the motion's torque, or none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.validation import validate
from robot_ident.recording import Recording
from robot_ident.recording.effort import as_reported
from robot_ident.recording.process import process
from robot_ident.robot import Robot, load_robot
from robot_ident.testbed.like_real import LikeReal, like_real


@pytest.fixture(scope="module")
def case() -> LikeReal:
    return like_real(load_robot(), 4001)


def declared(checkout: Path, folder: Path, effort: str) -> Robot:
    robots = checkout / "config/robots"
    text = (robots / "kuka_ir361.yaml").read_text(encoding="utf-8").replace("urdf: ", f"urdf: {robots}/")
    (folder / "arm.yaml").write_text(f"{text}effort: {effort}\n", encoding="utf-8")
    return load_robot(folder / "arm.yaml")


@pytest.fixture(scope="module")
def unsigned(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return declared(checkout, tmp_path_factory.mktemp("robot"), "{unsigned: true}")


def absolute(recording: Recording) -> Recording:
    return replace(recording, tau=np.abs(recording.tau))


def test_the_model_is_that_of_signed_efforts(case: LikeReal, unsigned: Robot) -> None:
    signed, folded = (
        identify([one], robot) for one, robot in ((case.train, load_robot()), (absolute(case.train), unsigned))
    )
    assert any("has no sign" in note for note in folded.notes)
    truth = validate(signed, case.test).residual
    for joint, found in validate(folded, absolute(case.test)).residual.items():
        assert found.rms < 1.05 * truth[joint].rms
    np.testing.assert_array_less(np.abs(folded.values - signed.values), 3.0 * signed.std)


def test_a_robot_that_reports_no_sign_is_simulated_so(case: LikeReal, unsigned: Robot) -> None:
    reported = as_reported(case.train.tau, case.train.q, unsigned)
    np.testing.assert_array_equal(reported, np.abs(case.train.tau))


def test_an_effort_that_has_a_sign_is_refused(case: LikeReal, unsigned: Robot) -> None:
    with pytest.raises(InputError, match="declared unsigned.*it has a sign"):
        process(case.train, unsigned)


def test_an_effort_that_the_motion_does_not_explain_gets_no_sign(case: LikeReal, unsigned: Robot) -> None:
    noise = np.random.default_rng(1).standard_normal(case.train.tau.shape) * case.train.tau.std(axis=0)
    with pytest.raises(InputError, match="its sign can't be told"):
        process(absolute(replace(case.train, tau=noise)), unsigned)
    loud = case.train.tau + 0.3 * noise
    with pytest.raises(InputError, match="too near zero"):
        process(absolute(replace(case.train, tau=loud)), unsigned)


@pytest.mark.parametrize(
    ("effort", "words"),
    [
        ("{unsigned: true, sign: -1}", "says nothing"),
        ("{unsigned: true, coupling: [[1,0,0],[0,1,0],[0,1,1]]}", "coupling"),
    ],
)
def test_what_cannot_be_unsigned(checkout: Path, tmp_path: Path, effort: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        declared(checkout, tmp_path, effort)
