"""Instrumental variables: no bias where the positions of a recording that doesn't repeat are noisy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.instruments import without_neighbours
from robot_ident.estimation.solve import solve
from robot_ident.recording import Processing, Recording, process
from robot_ident.signals.motion import Motion

RUNS = 12


def one_pass(arm: Any, seed: int, position: float) -> Recording:
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / 150.0
    m = arm.series.motion(1.7 * t)
    tau = arm.structure.columns(Motion(m.q, 1.7 * m.dq, 1.7**2 * m.ddq)) @ arm.structure.true_values()
    noise = rng.normal(size=(2, *m.q.shape))
    return Recording(arm.robot.joints, t, m.q + position * noise[0], tau + 5.0 * noise[1], source="once")


def bias(arm: Any, estimator: str, position: float) -> tuple[np.ndarray, np.ndarray]:
    """Return mean error and root mean square sigma [p]."""
    found = [
        solve([process(one_pass(arm, seed, position), arm.robot, Processing(periodic=False))], arm.structure, estimator)
        for seed in range(RUNS)
    ]
    error = np.array([f.values for f in found]) - arm.structure.true_values()
    return error.mean(axis=0), np.sqrt(np.mean([np.diag(f.covariance) for f in found], axis=0))


def test_bias_of_noisy_positions_is_taken_away(arm: Any) -> None:
    plain, _ = bias(arm, "wls", 1e-3)
    found, sigma = bias(arm, "iv", 1e-3)
    inertias = [arm.structure.names.index(name) for name in ("p8", "p15")]
    assert np.all(np.abs(plain[inertias]) > 4 * np.abs(found[inertias]))
    # what is quadratic in the noise no instrument takes away
    assert np.linalg.norm(found / sigma) < 0.4 * np.linalg.norm(plain / sigma)


def test_exact_positions_give_the_same_as_wls_with_honest_sigma(arm: Any) -> None:
    found, sigma = bias(arm, "iv", 0.0)
    assert np.abs(found / sigma).max() < 1.5
    model = identify([one_pass(arm, 0, 0.0)], arm.robot, estimator="iv", processing=Processing(periodic=False))
    assert any("iv agrees with wls" in note for note in model.notes)


def test_reconstruction_ignores_its_neighbours() -> None:
    t = np.arange(600) / 100.0
    q = np.column_stack([np.sin(2 * t), np.cos(3 * t)])
    motion = without_neighbours(q, 0.01, 6, 18)
    middle = slice(30, -30)
    np.testing.assert_allclose(motion.q[middle], q[middle], atol=1e-6)
    np.testing.assert_allclose(motion.dq[middle, 0], 2 * np.cos(2 * t)[middle], atol=1e-5)
    np.testing.assert_allclose(motion.ddq[middle, 0], -4 * np.sin(2 * t)[middle], atol=1e-3)
    bumped = q.copy()
    bumped[300] += 1.0
    other = without_neighbours(bumped, 0.01, 6, 18)
    np.testing.assert_allclose(other.ddq[295:306], motion.ddq[295:306], atol=1e-9)
    assert np.abs(other.ddq[290:294] - motion.ddq[290:294]).max() > 1.0


def test_periodic_recordings_are_their_own_instruments(arm: Any) -> None:
    iv, wls = (identify([arm.record(0, periods=4)], arm.robot, estimator=name) for name in ("iv", "wls"))
    np.testing.assert_allclose(iv.values, wls.values, atol=1e-6)
    np.testing.assert_allclose(iv.std, wls.std, rtol=1e-6)
    assert any("its own instrument" in note for note in iv.notes)


def test_too_short_for_instruments(arm: Any) -> None:
    with pytest.raises(InputError, match="too few for instruments"):
        without_neighbours(np.zeros((12, 3)), 0.01, 8, 24)
