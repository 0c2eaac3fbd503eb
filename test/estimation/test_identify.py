"""Identification: true parameters inside their uncertainty, which is what brute force says it is."""

from __future__ import annotations

from dataclasses import replace
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


@pytest.mark.parametrize("estimator", [pytest.param("ls", marks=pytest.mark.long), "wls"])
def test_errors_are_as_large_as_their_covariance_says(arm: Any, estimator: str) -> None:
    truth = arm.structure.true_values()
    found = [
        _distance(identify([arm.record(seed, periods=2, lead=0.0)], arm.robot, estimator=estimator), truth)
        for seed in range(30)
    ]
    # 30 recordings x 21 parameters; the variance itself is known to sqrt(2 / 4500)
    assert np.mean(found) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 630))


@pytest.mark.long
def test_friction_that_falls_with_speed_is_as_certain_as_it_says_whatever_its_exponent(arm: Any) -> None:
    """The exponent is a parameter like others: held at a value nearby, level and Coulomb friction are off by tens of
    their standard deviations.
    """
    truth = {"stribeck.level@joint_3": 20.0, "stribeck.vs@joint_3": 0.15, "stribeck.d@joint_3": 1.4}
    off = []
    for seed in range(12):
        recorded = arm.record(seed, periods=8, lead=0.0)
        dq = arm.series.motion(np.arange(len(recorded.t)) / 150.0).dq[:, 2]
        tau = recorded.tau.copy()
        tau[:, 2] += 20.0 * np.sign(dq) * np.exp(-((np.abs(dq) / 0.15) ** 1.4))
        model = identify([replace(recorded, tau=tau)], arm.robot, effects=["stribeck@joint_3"])
        names = [parameter.name for parameter in model.parameters]
        for name, true in (truth | dict(zip(arm.structure.names, arm.structure.true_values(), strict=True))).items():
            if name.endswith("joint_3"):
                off.append((model.values[names.index(name)] - true) / model.std[names.index(name)])
    # 12 recordings x 6 parameters, of which four hang together
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 36))


def test_sigmas_hold_whichever_form_an_effect_has(arm: Any) -> None:
    """Friction of a third kind, which a power of the speed and a tanh follow alike: noise decides between them."""

    def estimated(seed: int, noise: float) -> Any:
        recorded = arm.record(seed, periods=2, lead=0.0, noise=noise)
        dq = arm.series.motion(np.arange(len(recorded.t)) / 150.0).dq[:, 1]
        tau = recorded.tau.copy()
        tau[:, 1] += 8.0 * np.arcsinh(dq / 0.2)
        return identify([replace(recorded, tau=tau)], arm.robot, effects=["viscous_nonlinear@joint_2"])

    exact = estimated(0, 1e-3)
    names = [parameter.name for parameter in exact.parameters]
    own = [names.index(f"{name}@joint_2") for name in ("viscous", "coulomb")]
    models = [estimated(seed, 1.0) for seed in range(1, 9)]
    forms = [model.values[names.index("viscous_nonlinear.form@joint_2")] for model in models]
    assert len(set(forms)) == 2
    assert max(np.abs(model.values - exact.values)[own].max() for model in models) > 5.0
    for model in models:
        np.testing.assert_array_less(np.abs(model.values - exact.values)[own], 3.5 * model.std[own])
        assert any("viscous_nonlinear@joint_2 fits nearly as well with form" in note for note in model.notes)


def test_low_pass_keeps_the_covariance_honest(arm: Any) -> None:
    truth = arm.structure.true_values()
    found = [
        _distance(
            identify([arm.record(seed, periods=2, lead=0.0)], arm.robot, processing=Processing(low_pass=20.0)), truth
        )
        for seed in range(20)
    ]
    assert np.mean(found) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 420))


@pytest.mark.long
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
