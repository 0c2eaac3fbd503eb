"""Standard deviations that count what a model lacks: against fits done anew, and against many recordings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identify import identify
from robot_ident.recording import Processing, Recording
from robot_ident.regression.block_jackknife import block_jackknife
from robot_ident.trajectories.fourier_series import FourierSeries

PROCESSING = Processing(base_frequency=0.5, periodic=True)
PERIODS, RUNS = 6, 12


@pytest.mark.parametrize("known", [0.0, 20.0])
def test_it_is_that_of_fits_without_one_block(known: float) -> None:
    """known: root of the information before data, that the first parameter is 1."""
    rng = np.random.default_rng(0)
    x, blocks = rng.normal(size=(120, 4)), np.repeat(np.arange(12), 10)
    y = x @ [1.0, -2.0, 0.5, 3.0] + rng.normal(size=12).repeat(10)
    weights = rng.uniform(0.5, 2.0, size=120)
    root, prior = np.sqrt(weights), known * np.eye(1, 4)

    def fit(rows: np.ndarray) -> np.ndarray:
        left = np.vstack([root[rows, None] * x[rows], prior])
        found: np.ndarray = np.linalg.lstsq(left, np.append(root[rows] * y[rows], known), rcond=None)[0]
        return found

    theta = fit(np.ones(120, dtype=bool))
    without = np.array([fit(blocks != k) for k in range(12)]) - theta
    centred = without - without.mean(axis=0)
    expected = 11 / 12 * centred.T @ centred
    found = block_jackknife(x, weights[:, None] * x, y - x @ theta, blocks, prior.T @ prior)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


def record(arm: Any, seed: int, size: float) -> Recording:
    """Record random periods of 2 s at 100 Hz by a robot with a drag on joint 2 that no column of the model is."""
    rng = np.random.default_rng(seed)
    a, b = 0.36 * rng.normal(size=(2, 3, 5))
    t = np.arange(200 * PERIODS) / 100.0
    motion = FourierSeries(0.5, np.array([0.0, 0.2, -0.3]), a, b).motion(t)
    drag = size * np.tanh(3.0 * motion.q[:, 0]) * motion.dq[:, 1]
    tau = arm.structure.columns(motion) @ arm.structure.true_values() + np.outer(drag, [0.0, 1.0, 0.3])
    return Recording(arm.robot.joints, t, motion.q, tau + rng.normal(size=tau.shape), source=f"run {seed}")


def test_intervals_hold_for_other_motions_whatever_the_model_lacks(arm: Any) -> None:
    """Of two motions each; the value that all motions agree on lies within 95 % intervals as often as they say."""
    runs = [record(arm, seed, 30.0) for seed in range(2 * RUNS)]
    models = [identify(runs[k : k + 2], arm.robot, processing=PROCESSING) for k in range(0, 2 * RUNS, 2)]
    agreed = identify(runs, arm.robot, processing=PROCESSING).values
    inside = [
        np.mean([np.abs(one.values - agreed) < 1.96 * np.sqrt(np.diag(of(one))) for one in models])
        for of in (lambda one: one.covariance, lambda one: one.by_noise)
    ]
    assert 0.90 <= inside[0] <= 0.99
    assert inside[1] < 0.6
    assert all("standard deviations count what the model lacks" in " ".join(one.notes) for one in models)


def test_of_a_right_model_they_are_those_of_noise(arm: Any) -> None:
    model = identify([record(arm, seed, 0.0) for seed in range(2)], arm.robot, processing=PROCESSING)
    assert model.noise_covariance is None
    assert not any("exceeds the noise" in note for note in model.notes)


def test_both_are_kept_in_the_file(arm: Any, tmp_path: Any) -> None:
    model = identify([record(arm, seed, 30.0) for seed in range(2)], arm.robot, processing=PROCESSING)
    model.write(tmp_path / "model.yaml")
    again = type(model).read(tmp_path / "model.yaml")
    np.testing.assert_allclose(again.by_noise, model.by_noise)
    np.testing.assert_allclose(again.covariance, model.covariance)
    assert np.all(np.diag(model.covariance) >= np.diag(model.by_noise) * (1.0 - 1e-9))
    assert replace(model, noise_covariance=None).by_noise is model.covariance
