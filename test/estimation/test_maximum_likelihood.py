"""Maximum likelihood: unbiased where the encoder is coarse, the same as wls where it is fine, its bound honest."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate, identify
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.trajectories.fourier_series import FourierSeries

PROCESSING = Processing(base_frequency=0.5, periodic=True)
RUNS = 20


def coarse(arm: Any, seed: int, *, periods: int = 4, position: float = 2e-3, rounded: bool = False) -> Recording:
    """Record 2 s periods at 100 Hz with an encoder that is hardly good enough for acceleration."""
    rng = np.random.default_rng(1)
    a, b = 0.36 * rng.normal(size=(2, 3, 5))
    rng = np.random.default_rng(seed)
    t = np.arange(200 * periods) / 100.0
    motion = FourierSeries(0.5, np.array([0.0, 0.2, -0.3]), a, b).motion(t)
    tau = arm.structure.columns(motion) @ arm.structure.true_values() + rng.normal(size=motion.q.shape)
    q = motion.q + position * rng.normal(size=motion.q.shape)
    if rounded:
        q = np.round(q / position) * position
    return Recording(arm.robot.joints, t, q, tau, source="coarse")


def errors(arm: Any, estimator: str, **options: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return the errors over sigma [runs, p] and the squared distances e' C^-1 e [runs] by torque noise alone."""
    truth, scaled, distance = arm.structure.true_values(), [], []
    for seed in range(RUNS):
        model = identify([coarse(arm, seed, **options)], arm.robot, estimator=estimator, processing=PROCESSING)
        error = model.values - truth
        scaled.append(error / np.sqrt(np.diag(model.by_noise)))
        distance.append(error @ np.linalg.solve(model.by_noise, error))
    return np.array(scaled), np.array(distance)


def test_wls_is_biased_by_a_coarse_encoder_and_ml_is_not(arm: Any) -> None:
    wls, far = errors(arm, "wls")
    ml, near = errors(arm, "ml")
    # without bias the mean of 20 runs has sigma 1 / sqrt(20)
    assert np.abs(wls.mean(axis=0)).max() > 2.0
    assert np.abs(ml.mean(axis=0)).max() < 3.5 / np.sqrt(RUNS)
    assert np.mean(far) / 21 > 20.0
    assert np.mean(near) / 21 == pytest.approx(1.0, abs=4 * np.sqrt(2 / (21 * RUNS)))


def test_rounding_of_the_encoder_counts_as_noise(arm: Any) -> None:
    _, near = errors(arm, "ml", position=3e-3, rounded=True)
    assert np.mean(near) / 21 == pytest.approx(1.0, abs=4 * np.sqrt(2 / (21 * RUNS)))


def test_ml_says_whether_it_differs(arm: Any) -> None:
    rough = identify([coarse(arm, 0)], arm.robot, estimator="ml", processing=PROCESSING)
    assert "ml differs from wls" in rough.notes[-1] or any("ml differs from wls" in note for note in rough.notes)
    fine = identify([arm.record(0)], arm.robot, estimator="ml")
    assert any("ml agrees with wls" in note for note in fine.notes)
    wls = identify([arm.record(0)], arm.robot)
    assert np.abs((fine.values - wls.values) / wls.std).max() < 0.01
    np.testing.assert_allclose(fine.std, wls.std, rtol=0.02)


def test_the_bound_is_that_of_the_joint_information(arm: Any) -> None:
    """Form J and W of eq. (6) densely, by differences, and compare."""
    from robot_ident.estimation.maximum_likelihood import Trajectory, _at
    from robot_ident.estimation.problem import Problem

    measured = process(coarse(arm, 3), arm.robot, PROCESSING)
    model = estimate([measured], arm.structure, estimator="ml")
    problem = Problem([measured], arm.structure)
    trajectory = Trajectory.of(measured, arm.structure, model.values)
    state = _at(problem, [trajectory], arm.structure, model.values, [np.zeros(len(trajectory.joint))])
    columns = [state.equations.phi]
    for k, sigma in enumerate(np.sqrt(trajectory.variance)):
        ends = []
        for side in (-1e-2, 1e-2):
            delta = np.zeros(len(trajectory.joint))
            delta[k] = side * sigma
            moved = _at(problem, [trajectory], arm.structure, model.values, [delta])
            ends.append(moved.equations.phi @ model.values)
        columns.append(((ends[1] - ends[0]) / (2e-2 * sigma))[:, None])
    j = np.hstack(columns)
    w = 1.0 / problem.variance
    information = j.T @ (j * w[:, None])
    information[21:, 21:] += np.diag(1.0 / trajectory.variance)
    scale = np.sqrt(np.diag(information))
    bound = (np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale))[:21, :21]
    # at the measured trajectory instead of the estimated one
    np.testing.assert_allclose(model.std, np.sqrt(np.diag(bound)), rtol=0.05)


def test_several_recordings_and_inner_coefficients_together(arm: Any) -> None:
    one, two = coarse(arm, 1), coarse(arm, 2)
    both = identify([one, two], arm.robot, estimator="ml", processing=PROCESSING, effects=["torque_offset@joint_1"])
    alone = identify([one], arm.robot, estimator="ml", processing=PROCESSING, effects=["torque_offset@joint_1"])
    np.testing.assert_allclose(both.std, alone.std / np.sqrt(2), rtol=0.15)
    truth = Structure.build(arm.robot, ["torque_offset@joint_1"]).true_values()
    error = both.values - truth
    assert error @ np.linalg.solve(both.covariance, error) < 50.0


def test_what_does_not_repeat_is_refused(arm: Any) -> None:
    with pytest.raises(InputError, match="ml estimates the lines of a periodic motion"):
        identify([arm.record(0, periods=2)], arm.robot, estimator="ml", processing=Processing(periodic=False))
