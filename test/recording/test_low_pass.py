"""Low passes without phase: gain, derivatives and the noise that passes."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import load_robot
from robot_ident.signals.filters import PeriodicLowPass, ZeroPhaseLowPass

KUKA = load_robot("kuka_ir361")


@pytest.mark.parametrize("frequency", [0.5, 5.0, 10.0, 20.0])
def test_gain_is_butterworths_squared_and_phase_zero(frequency: float) -> None:
    t = np.arange(6000) / 500.0
    x = np.sin(2 * np.pi * frequency * t)
    y = ZeroPhaseLowPass(10.0, 1 / 500, len(t)).apply(x)
    gain = 1 / (1 + (frequency / 10.0) ** 8)
    middle = slice(1500, 4500)
    np.testing.assert_allclose(y[middle], gain * x[middle], atol=2e-3)


def test_derivatives_are_exact_in_the_band() -> None:
    t = np.arange(4001) / 500.0
    w = 2 * np.pi * 0.8
    x = np.column_stack([np.sin(w * t), t**2 / 10])
    low_pass = ZeroPhaseLowPass(20.0, 1 / 500, len(t))
    middle = slice(800, 3200)
    np.testing.assert_allclose(low_pass.apply(x, 1)[middle, 0], (w * np.cos(w * t))[middle], atol=1e-4)
    np.testing.assert_allclose(low_pass.apply(x, 1)[middle, 1], (t / 5)[middle], atol=1e-4)
    np.testing.assert_allclose(low_pass.apply(x, 2)[middle, 0], (-(w**2) * np.sin(w * t))[middle], atol=1e-2)


def test_white_noise_passes_as_counted() -> None:
    rng = np.random.default_rng(0)
    low_pass = ZeroPhaseLowPass(10.0, 1 / 150, 60_000)
    noise = low_pass.apply(rng.normal(size=60_000))
    assert np.var(noise[500:-500]) == pytest.approx(low_pass.independent, rel=0.05)
    slope = low_pass.apply(rng.normal(size=60_000), 1)
    assert np.std(slope[500:-500]) == pytest.approx(low_pass.noise_gain(1), rel=0.05)


def test_a_constant_and_a_line_pass_unchanged() -> None:
    t = np.arange(2000) / 200.0
    y = ZeroPhaseLowPass(5.0, 1 / 200, 2000).apply(np.column_stack([0 * t + 3.0, 2 * t]))
    np.testing.assert_allclose(y, np.column_stack([0 * t + 3.0, 2 * t]), atol=2e-2)


def test_periodic_low_pass_keeps_lines_up_to_the_cutoff() -> None:
    t = np.arange(1000) / 1000 * 10
    x = np.sin(2 * np.pi * 0.7 * t) + np.sin(2 * np.pi * 3.1 * t)
    low_pass = PeriodicLowPass(2.0, 0.1, 1000)
    np.testing.assert_allclose(low_pass.apply(x), np.sin(2 * np.pi * 0.7 * t), atol=1e-12)
    assert low_pass.independent == pytest.approx(41 / 1000)


@pytest.mark.parametrize("samples", [1998, 2000, 2014, 2048])
@pytest.mark.parametrize("cutoff", [2.0, 10.0, 40.0])
def test_a_motion_that_ends_elsewhere_is_differentiated_without_ringing(samples: int, cutoff: float) -> None:
    t = np.arange(samples) * 0.01
    motion, speed = 1.5 * np.sin(0.7 * t) + 0.4 * t, 1.05 * np.cos(0.7 * t) + 0.4
    error = ZeroPhaseLowPass(cutoff, 0.01, samples).apply(motion, 1) - speed
    assert np.abs(error).max() < 0.04  # where the reflection at an end bends
    assert np.abs(error[100:-100]).max() < 5e-4


@pytest.mark.parametrize("noise", [1e-5, 1e-4, 1e-3])
def test_a_velocity_tells_a_reversal_as_well_as_any_bandwidth(noise: float) -> None:
    """A joint that slows down for half a second and breaks away backwards at 1 rad/s: rows of the wrong direction."""
    t = np.arange(0.0, 20.0, 0.001)
    phase = t / 0.5 % 2.0
    speed = np.where(phase < 1.0, 1.0 - phase, phase - 2.0)
    rng = np.random.default_rng(1)
    q = np.stack([np.cumsum(speed) * 0.001, np.sin(t), np.sin(t)], axis=1) + rng.normal(size=(len(t), 3)) * noise
    recording = Recording(KUKA.joints, t, q, rng.normal(size=q.shape), source="breaks away")

    def wrong(bandwidth: float | None) -> int:
        asked = Processing(periodic=False, low_pass=5.0, derivative_bandwidth=10.0, velocity_bandwidth=bandwidth)
        return int(np.sum(process(recording, KUKA, asked).motion.dq[:, 0] * speed < 0.0))

    best = min(map(wrong, np.geomspace(10.0, 400.0, 16)))
    assert wrong(None) <= 1.7 * best
    assert wrong(None) <= 0.4 * wrong(10.0), "to the bandwidth of accelerations"


@pytest.mark.parametrize("speed", [0.03, 0.1])
def test_slow_motion_counts_although_its_reversals_are_sharp(speed: float) -> None:
    """An encoder of .5 mrad noise at 200 Hz; the velocity that tells a reversal best has much of its noise."""
    t = np.arange(0.0, 60.0, 0.005)
    ramps = np.convolve(speed * np.sign(np.sin(2.0 * np.pi * t / 6.0)), np.ones(9) / 9.0, "same")
    rng = np.random.default_rng(1)
    q = np.stack([np.cumsum(ramps) * 0.005, 0.3 * np.sin(t), 0.3 * np.sin(t)], axis=1)
    recording = Recording(KUKA.joints, t, q + rng.normal(size=q.shape) * 5e-4, rng.normal(size=q.shape), source="slow")
    measured = process(recording, KUKA, Processing(periodic=False, low_pass=5.0, derivative_bandwidth=10.0))
    assert measured.used.mean(axis=0).min() > 0.9
    right = measured.motion.dq[:, 0] * ramps > 0.0
    assert right[measured.used[:, 0]].mean() > 0.995
