"""Validation on full stops: what is left of a true model is the noise, filtered the same way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.prediction import predict
from robot_ident.estimation.validation import validate
from robot_ident.planning.validation_motion import validation_motion
from robot_ident.recording import Recording
from robot_ident.testbed.simulation import simulate


@pytest.mark.long
def test_residual_of_the_true_model_is_the_filtered_noise(arm: Any) -> None:
    model = identify([arm.record(seed) for seed in range(6)], arm.robot)
    motion = validation_motion(arm.robot, seed=3)
    ratios = []
    for seed in range(20):
        result = validate(model, simulate(arm.robot, motion, seed=seed).recording)
        for fit in result.residual.values():
            assert fit.noise_variance is not None
            ratios.append(fit.mse / fit.noise_variance)
    # about 500 independent values a recording and joint: 4.5 sigma each, 4 sigma of the mean of sixty
    assert np.abs(np.array(ratios) - 1.0).max() < 4.5 * np.sqrt(2 / 500)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


@pytest.mark.long
def test_noise_of_positions_counts_as_far_as_they_are_differentiated(arm: Any) -> None:
    """A base chosen by prediction differentiates positions far below the band in which torques are compared."""
    robot = replace(arm.robot, base="prediction")
    model = identify([arm.record(seed) for seed in range(3)], robot)
    motion, ratios = validation_motion(robot, seed=3), []
    for seed in range(4):
        measured = simulate(robot, motion, seed=seed).recording
        ratios += [fit.mse / (fit.noise_variance or 0.0) for fit in validate(model, measured).residual.values()]
    assert min(ratios) > 0.8 and max(ratios) < 1.25


def test_a_wrong_model_is_seen(arm: Any) -> None:
    model = identify([arm.record(0)], arm.robot)
    motion = validation_motion(arm.robot, seed=4)
    recording = simulate(arm.robot, motion, seed=1, effects=["coulomb@joint_2:30"]).recording
    fit = validate(model, recording).residual["joint_2"]
    assert fit.noise_variance is not None
    assert fit.mse > 3.0 * fit.noise_variance


def test_rest_can_not_be_validated(arm: Any) -> None:
    model = identify([arm.record(0, periods=2)], arm.robot)
    t = np.arange(2000) / 150.0
    rest = Recording(arm.robot.joints, t, np.zeros((2000, 3)), np.ones((2000, 3)), source="rest")
    with pytest.raises(InputError, match="no joint moves"):
        validate(model, rest)


@pytest.mark.parametrize(
    ("stated", "most", "shown"),
    [
        ({}, 75.0, 10.0),
        ({"low_pass": 3.0}, 75.0, 3.0),
        ({"low_pass": 30.0, "band": 6.0}, 75.0, 6.0),
        ({"band": 55.0}, 75.0, 55.0),
        ({"band": 400.0}, 75.0, 60.0),  # of 150 samples a second
        ({"band": 400.0, "anti_alias": (4, 20.0)}, 75.0, None),  # no more than can be undone
        ({}, 10.0, 4.0),  # of 20 samples a second
    ],
)
def test_a_validation_takes_the_low_pass_of_a_prediction(
    arm: Any, stated: dict[str, Any], most: float, shown: float | None
) -> None:
    model = identify([arm.record(0)], arm.robot)
    model = replace(model, processing={**model.processing, **stated})
    motion = validation_motion(arm.robot, seed=5)
    recording = simulate(arm.robot, motion, seed=1, sample_rate=2.0 * most).recording
    found = validate(model, recording)
    assert found.low_pass_hz == pytest.approx(shown or 20.0, rel=0.3 if shown is None else 1e-3)
    passed = f"low-passed at {found.low_pass_hz:g} Hz"
    assert any(passed in note for note in found.notes)
    assert any(passed in note for note in predict(model, recording).notes)
