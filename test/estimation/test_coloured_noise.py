"""Coloured and shared noise: intervals stay honest, and weighting by it pays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from robot_ident.estimation.solve import solve
from robot_ident.recording import Processing, Recording, process

RUNS = 8


def recordings(arm: Any, pole: float, shared: float, periods: int = 4) -> list[Recording]:
    exact = arm.record(0, periods=periods, lead=0.0, noise=0.0)
    across = np.linalg.cholesky((1 - shared) * np.eye(3) + shared) * np.sqrt(arm.robot.noise.torque_variance)[:, None]
    out = []
    for seed in range(RUNS):
        rng = np.random.default_rng(seed)
        white = rng.normal(size=(exact.samples + 300, 3)) * np.sqrt(1 - pole**2)
        tau = exact.tau + lfilter([1.0], [1.0, -pole], white, axis=0)[300:] @ across.T
        q = exact.q + rng.normal(size=tau.shape) * np.sqrt(arm.robot.noise.position_variance)
        out.append(Recording(exact.names, exact.t, q, tau))
    return out


@pytest.mark.parametrize(("pole", "shared"), [(0.9, 0.0), (0.7, 0.5)])
@pytest.mark.parametrize(
    ("estimator", "low_pass"), [("wls", None), pytest.param("ls", None, marks=pytest.mark.long), ("wls", 15.0)]
)
def test_intervals_are_honest(arm: Any, pole: float, shared: float, estimator: str, low_pass: float | None) -> None:
    truth = arm.structure.true_values()
    found = []
    for recording in recordings(arm, pole, shared):
        solution = solve([process(recording, arm.robot, Processing(low_pass=low_pass))], arm.structure, estimator)
        error = solution.values - truth
        found.append(error @ np.linalg.solve(solution.covariance, error) / len(truth))
    # the spectrum at the lines of the motion is known from few degrees of freedom: 15 % more are allowed for
    spread = 4 * np.sqrt(2 / (21 * RUNS))
    assert 1 - spread < np.mean(found) < 1.15 + spread


def test_weighting_by_the_spectrum_sharpens_the_friction(arm: Any) -> None:
    recording = recordings(arm, 0.9, 0.0)[0]
    measured = process(recording, arm.robot)
    plain = np.sqrt(np.diag(solve([measured], arm.structure, "ls").covariance))
    weighted = np.sqrt(np.diag(solve([measured], arm.structure, "wls").covariance))
    assert np.all(weighted <= plain * 1.001)
    assert np.all(weighted[18:] < 0.6 * plain[18:])  # Coulomb's harmonics lie where this noise is low


def test_chi_square_of_a_true_model_is_its_degrees_of_freedom(arm: Any) -> None:
    ratios = []
    for recording in recordings(arm, 0.9, 0.3):
        found = solve([process(recording, arm.robot)], arm.structure, "wls")
        ratios.append(found.chi_square / found.dof)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.04)


def test_ml_uses_the_same_noise(arm: Any) -> None:
    measured = process(recordings(arm, 0.8, 0.4)[1], arm.robot)
    wls, ml = (solve([measured], arm.structure, name) for name in ("wls", "ml"))
    np.testing.assert_allclose(np.diag(ml.covariance), np.diag(wls.covariance), rtol=0.01)


def test_colour_does_not_weigh_what_the_model_lacks(arm: Any) -> None:
    """A torque that no column explains, a hundred times the noise: parameters stay those of ordinary least squares."""
    recording = recordings(arm, 0.9, 0.0)[0]
    lacking = 60.0 * np.sin(3.0 * recording.q[:, [1, 1, 1]] + 1.0) * [0.0, 1.0, 0.0]
    loud = Recording(recording.names, recording.t, recording.q, recording.tau + lacking, source="loud")
    measured = process(loud, arm.robot)
    assert measured.noise is not None
    assert measured.noise.coloured[1]
    plain, weighted = (solve([measured], arm.structure, name) for name in ("ls", "wls"))
    (line,) = [note for note in weighted.notes if "not by its colour" in note]
    assert line.startswith("loud: the residual is far more than noise")
    truth = arm.structure.true_values()
    assert np.linalg.norm((weighted.values - truth)[15:]) < 1.2 * np.linalg.norm((plain.values - truth)[15:])
    quiet = solve([process(recording, arm.robot)], arm.structure, "wls")
    assert not any("not by its colour" in note for note in quiet.notes)


@pytest.mark.parametrize("estimator", ["wls", pytest.param("ml", marks=pytest.mark.long)])
def test_intervals_without_the_weight_of_colour_are_honest(arm: Any, estimator: str) -> None:
    """The weights are forced to be plain; the covariance still counts the colour."""
    from robot_ident.estimation import least_squares

    truth, found = arm.structure.true_values(), []
    before = least_squares._NOT_NOISE
    least_squares._NOT_NOISE = 0.0
    try:
        for recording in recordings(arm, 0.9, 0.0):
            solution = solve([process(recording, arm.robot)], arm.structure, estimator)
            error = solution.values - truth
            found.append(error @ np.linalg.solve(solution.covariance, error) / len(truth))
    finally:
        least_squares._NOT_NOISE = before
    spread = 4 * np.sqrt(2 / (21 * RUNS))
    assert 1 - spread < np.mean(found) < 1.15 + spread
