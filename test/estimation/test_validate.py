"""Validation on full stops: what is left of a true model is the noise, filtered the same way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
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
