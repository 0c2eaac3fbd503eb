"""Noise from the periods: its colour, what joints share, outlying periods."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from robot_ident.recording import Recording, process
from robot_ident.recording.averaging import outlying_periods
from robot_ident.recording.noise_spectrum import noise_spectrum


def coloured(seed: int, shape: tuple[int, int], pole: float, shared: float = 0.0) -> np.ndarray:
    """Return noise [N, n] of variance 1: autoregressive with a pole, correlated across joints."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=(shape[0] + 300, shape[1])) * np.sqrt(1 - pole**2)
    across = np.linalg.cholesky((1 - shared) * np.eye(shape[1]) + shared)
    return lfilter([1.0], [1.0, -pole], white, axis=0)[300:] @ across.T


def test_white_noise_is_called_white_and_its_variance_is_right() -> None:
    called = 0
    for seed in range(40):
        x = coloured(seed, (8 * 500, 3), 0.0).reshape(8, 500, 3)
        spectrum = noise_spectrum(x, np.ones(3))
        called += not spectrum.white
        np.testing.assert_allclose(spectrum.covariance(), np.eye(3), atol=0.02)
    assert called == 0


@pytest.mark.parametrize("pole", [0.6, 0.9, -0.5])
def test_colour_is_found_and_its_autocovariance_is_right(pole: float) -> None:
    x = coloured(1, (16 * 1500, 2), pole).reshape(16, 1500, 2)
    spectrum = noise_spectrum(x, np.ones(2))
    assert spectrum.coloured == (True, True)
    assert not spectrum.correlated
    np.testing.assert_allclose(spectrum.autocovariance()[:6, 0, 0], pole ** np.arange(6), atol=0.06)


def test_noise_shared_by_joints_is_found() -> None:
    x = coloured(2, (8 * 800, 3), 0.5, shared=0.3).reshape(8, 800, 3)
    spectrum = noise_spectrum(x, np.ones(3))
    assert spectrum.correlated
    np.testing.assert_allclose(spectrum.covariance(), 0.7 * np.eye(3) + 0.3, atol=0.05)
    # E[n_0(t) n_1(t + lag)]
    np.testing.assert_allclose(spectrum.autocovariance()[1, 0, 1], 0.15, atol=0.03)


def test_spectrum_multiplies_as_its_covariance_matrix() -> None:
    spectrum = noise_spectrum(coloured(3, (6 * 200, 2), 0.7, shared=0.4).reshape(6, 200, 2), np.ones(2))
    lagged = spectrum.autocovariance()
    t = np.arange(200)
    dense = lagged[(t[None, :] - t[:, None]) % 200].transpose(0, 2, 1, 3).reshape(400, 400)
    np.testing.assert_allclose(dense, dense.T, atol=1e-12)
    x = np.random.default_rng(0).normal(size=(200, 2, 3))
    np.testing.assert_allclose(spectrum.multiply(x).reshape(400, 3), dense @ x.reshape(400, 3), atol=1e-10)


def test_gaps_are_no_colour() -> None:
    x = coloured(4, (8 * 600, 1), 0.0).reshape(8, 600, 1)
    x[np.random.default_rng(0).random((8, 600)) < 0.1] = np.nan
    assert noise_spectrum(x, np.ones(1)).white


def test_period_that_was_disturbed_is_found_and_left_out(arm: Any) -> None:
    r = arm.record(0, periods=8, lead=0.0)
    tau = np.array(r.tau)
    tau[4 * 1500 + 300 : 4 * 1500 + 420, 1] += 120.0  # somebody leant on the arm for .8 s
    measured = process(Recording(r.names, r.t, r.q, tau), arm.robot)
    assert measured.left_out == (5,)
    assert measured.periods == 7
    assert any("period 5 of 8 left out" in note for note in measured.notes)
    np.testing.assert_allclose(measured.torque_variance / arm.robot.noise.torque_variance, 1.0, atol=0.06)


def test_undisturbed_periods_are_all_kept(arm: Any) -> None:
    for seed in range(10):
        assert process(arm.record(seed, periods=6, lead=0.0), arm.robot).left_out == ()
    for seed in range(20):
        assert outlying_periods(coloured(seed, (16 * 1000, 3), 0.95).reshape(16, 1000, 3)) == []


def test_half_of_the_periods_are_no_outliers() -> None:
    x = coloured(5, (8 * 1000, 1), 0.0).reshape(8, 1000, 1)
    x[:4, 200:300] += 30.0
    assert outlying_periods(x) == []
