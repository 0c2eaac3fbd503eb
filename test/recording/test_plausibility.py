"""Efforts that nobody measured are refused, whatever is to be done with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.equations import fit
from robot_ident.estimation.identify import estimate
from robot_ident.estimation.prediction import predict
from robot_ident.estimation.validation import validate
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.process import process
from robot_ident.recording.summary import summarise


@pytest.mark.parametrize("value", [0.0, 37.0])
def test_an_effort_that_never_changes_on_a_joint_that_moves(arm: Any, value: float) -> None:
    recording = arm.record(1, periods=3)
    tau = np.array(recording.tau)
    tau[:, 1] = value
    dead = replace(recording, tau=tau, source="b.npz")
    said = (
        f"b.npz: the effort of joint_2 is {value:g} in every sample, though it moves: its driver publishes none;"
        " record with joint_2 standing still, and identify --joints joint_1,joint_3"
    )
    with pytest.raises(InputError) as refused:
        process(dead, arm.robot)
    assert str(refused.value) == said
    model = estimate([process(recording, arm.robot)], arm.structure)
    with pytest.raises(InputError, match="joint_2"):
        validate(model, dead)
    np.testing.assert_array_equal(predict(model, dead).torque, predict(model, recording).torque)
    assert any(f"joint_2 is {value:g} in every sample" in note for note in summarise(dead).notes)


def test_a_joint_that_stands_still_may_need_no_effort(arm: Any) -> None:
    recording = arm.record(1, periods=3)
    q, tau = np.array(recording.q), np.array(recording.tau)
    q[:, 0], tau[:, 0] = 0.2, 0.0
    assert isinstance(process(replace(recording, q=q, tau=tau), arm.robot), Measurement)


def test_a_torque_of_nothing_has_no_relative_error() -> None:
    assert fit(np.ones(5), np.zeros(5), np.ones(5)).relative is None
