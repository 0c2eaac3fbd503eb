"""The Fourier series: eq. (11) as printed, its derivatives, its extremes in continuous time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robot_ident.trajectories.fourier_series import FourierSeries, trigonometric_extremes


def random_series(seed: int, joints: int = 3, harmonics: int = 5) -> FourierSeries:
    rng = np.random.default_rng(seed)
    shape = (joints, harmonics)
    return FourierSeries(0.1, rng.uniform(-0.5, 0.5, joints), rng.normal(size=shape), rng.normal(size=shape))


def test_motion_is_equation_11_as_printed() -> None:
    series = random_series(1, joints=2, harmonics=3)
    t, w = 3.7, 2 * math.pi * 0.1
    motion = series.motion(np.array([t]))
    for i in range(2):
        q, dq, ddq = series.q0[i], 0.0, 0.0
        for harmonic in (1, 2, 3):
            a, b = series.a[i, harmonic - 1], series.b[i, harmonic - 1]
            wl = w * harmonic
            q += a / wl * math.sin(wl * t) - b / wl * math.cos(wl * t)
            dq += a * math.cos(wl * t) + b * math.sin(wl * t)
            ddq += -a * wl * math.sin(wl * t) + b * wl * math.cos(wl * t)
        assert motion.q[0, i] == pytest.approx(q, abs=1e-13)
        assert motion.dq[0, i] == pytest.approx(dq, abs=1e-13)
        assert motion.ddq[0, i] == pytest.approx(ddq, abs=1e-13)


def test_velocity_and_acceleration_are_the_derivatives() -> None:
    series, h = random_series(2), 1e-6
    t = np.linspace(0.0, 10.0, 57)
    before, here, after = (series.motion(t + shift) for shift in (-h, 0.0, h))
    np.testing.assert_allclose((after.q - before.q) / (2 * h), here.dq, atol=1e-7)
    np.testing.assert_allclose((after.dq - before.dq) / (2 * h), here.ddq, atol=1e-7)


def test_a_period_later_the_motion_is_the_same() -> None:
    series = random_series(3)
    t = np.linspace(0.0, series.period, 11)
    np.testing.assert_allclose(series.motion(t + 3 * series.period).q, series.motion(t).q, atol=1e-12)
    assert series.period == 10.0


@pytest.mark.parametrize("seed", range(20))
def test_extremes_are_those_of_a_dense_search(seed: int) -> None:
    series = random_series(seed, harmonics=1 + seed % 7)
    dense = series.motion(np.linspace(0.0, 10.0, 100_001))
    for extremes, values in zip(series.extremes(), (dense.q, dense.dq, dense.ddq), strict=True):
        for exact, found in ((extremes.upper, values.max(axis=0)), (-extremes.lower, -values.min(axis=0))):
            assert np.all(exact >= found - 1e-13), "a dense search found a larger value"
            np.testing.assert_allclose(exact, found, atol=1e-6)


def test_extremes_are_reached_at_their_times() -> None:
    series = random_series(5)
    for index, extremes in enumerate(series.extremes()):
        for values, times in ((extremes.lower, extremes.lower_time), (extremes.upper, extremes.upper_time)):
            for joint in range(3):
                state = series.motion(times[joint : joint + 1])
                assert (state.q, state.dq, state.ddq)[index][0, joint] == pytest.approx(values[joint], abs=1e-12)


def test_extremes_survive_joints_at_rest_and_missing_harmonics() -> None:
    a = np.zeros((4, 5))
    a[1, 0], a[2, 4], a[3, :2] = 0.7, 0.3, (0.5, 1e-18)
    series = FourierSeries(0.1, np.array([0.4, 0.0, 0.0, 0.0]), a, np.zeros((4, 5)))
    q, dq, _ = series.extremes()
    assert (q.lower[0], q.upper[0]) == (0.4, 0.4)
    np.testing.assert_allclose(dq.upper, [0.0, 0.7, 0.3, 0.5], atol=1e-12)
    np.testing.assert_allclose(dq.lower, [0.0, -0.7, -0.3, -0.5], atol=1e-12)
    np.testing.assert_allclose(q.upper[1:3], [0.7 / (0.2 * math.pi), 0.3 / math.pi], atol=1e-12)


def test_a_double_stationary_point_is_no_obstacle() -> None:
    cosine, sine = np.array([[4.0, 1.0]]), np.zeros((1, 2))  # 4 cos x + cos 2x: second derivative vanishes at x = pi
    extremes = trigonometric_extremes(np.zeros(1), cosine, sine, 1.0)
    assert extremes.lower[0] == pytest.approx(-3.0, abs=1e-12)
    assert extremes.upper[0] == pytest.approx(5.0, abs=1e-12)


def test_coefficients_must_agree() -> None:
    with pytest.raises(ValueError, match="shape"):
        FourierSeries(0.1, np.zeros(2), np.zeros((2, 3)), np.zeros((2, 4)))
    with pytest.raises(ValueError, match="base frequency"):
        FourierSeries(0.0, np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)))
