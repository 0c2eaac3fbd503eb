"""Identification: true parameters inside their uncertainty, which is what brute force says it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.model.model_file import read_model, write_model
from robot_ident.recording import Processing


def _distance(model: Any, truth: np.ndarray) -> float:
    error = model.values - truth
    return float(error @ np.linalg.solve(model.covariance, error)) / len(truth)


@pytest.mark.parametrize("estimator", ["ls", "wls"])
def test_errors_are_as_large_as_their_covariance_says(arm: Any, estimator: str) -> None:
    truth = arm.structure.true_values()
    found = [
        _distance(identify([arm.record(seed, periods=2, lead=0.0)], arm.robot, estimator=estimator), truth)
        for seed in range(30)
    ]
    # 30 recordings x 21 parameters; the variance itself is known to sqrt(2 / 4500)
    assert np.mean(found) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 630))


def test_low_pass_keeps_the_covariance_honest(arm: Any) -> None:
    truth = arm.structure.true_values()
    found = [
        _distance(
            identify([arm.record(seed, periods=2, lead=0.0)], arm.robot, processing=Processing(low_pass=20.0)), truth
        )
        for seed in range(20)
    ]
    assert np.mean(found) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 420))


def test_residual_of_the_true_model_is_the_noise(arm: Any) -> None:
    ratios = []
    for seed in range(20):
        model = identify([arm.record(seed)], arm.robot)
        for fit in model.residual.values():
            assert fit.noise_variance is not None
            ratios.append(fit.mse / fit.noise_variance)
    assert np.abs(np.array(ratios) - 1).max() < 0.13
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)


def test_two_recordings_tell_as_much_as_both(arm: Any) -> None:
    one, two = arm.record(1, periods=4), arm.record(2, periods=4)
    alone, both = identify([one], arm.robot), identify([one, two], arm.robot)
    np.testing.assert_allclose(both.std, alone.std / np.sqrt(2), rtol=0.05)
    assert _distance(both, arm.structure.true_values()) < 2.0


def test_one_pass_without_periods_gives_honest_errors(arm: Any) -> None:
    truth = arm.structure.true_values()
    options = Processing(periodic=False)
    found = [
        _distance(identify([arm.record(seed, periods=2, lead=0.0)], arm.robot, processing=options), truth)
        for seed in range(8)
    ]
    assert 0.5 < np.mean(found) < 2.0
    model = identify([arm.record(0, periods=2)], arm.robot, processing=options)
    assert model.noise.torque_variance == (None, None, None)


def test_condition_number_and_determinant_are_the_papers(arm: Any) -> None:
    model = identify([arm.record(1)], arm.robot)
    f = arm.structure.columns(arm.series.motion(np.arange(1500) / 150))
    variance = np.array([fit.noise_variance for fit in model.residual.values()])
    weighted = (f / np.sqrt(variance)[:, None]).reshape(-1, 21)
    normal = weighted / np.linalg.norm(weighted, axis=0)
    singular = np.linalg.svd(normal, compute_uv=False)
    assert model.condition_number == pytest.approx(singular[0] / singular[-1], rel=0.02)
    _, logdet = np.linalg.slogdet(weighted.T @ weighted)
    assert model.log10_det_covariance == pytest.approx(-logdet / np.log(10), abs=0.1)


def test_model_file_is_read_back_to_the_last_digit(arm: Any, tmp_path: Path) -> None:
    model = identify([arm.record(1)], arm.robot, effects=["torque_offset@joint_2"])
    write_model(model, tmp_path / "model.yaml")
    again = read_model(tmp_path / "model.yaml")
    np.testing.assert_array_equal(again.values, model.values)
    np.testing.assert_array_equal(again.covariance, model.covariance)
    assert again.to_dict() == model.to_dict()
    motion = arm.series.motion(np.arange(30) / 7.0)
    np.testing.assert_array_equal(again.predict(motion), model.predict(motion))


def test_joints_that_stand_still_are_named(arm: Any) -> None:
    from robot_ident.recording import Recording

    r = arm.record(1, periods=3)
    q, tau = np.array(r.q), np.array(r.tau)
    q[:, 2] = 0.3
    with pytest.raises(InputError, match="joint_3"):
        identify([Recording(r.names, r.t, q, tau)], arm.robot)


@pytest.mark.parametrize(("estimator", "words"), [("wsl", "did you mean 'wls'"), ("", "unknown estimator")])
def test_unknown_estimator(arm: Any, estimator: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        identify([arm.record(1, periods=2)], arm.robot, estimator=estimator)
