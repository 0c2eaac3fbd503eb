"""Periods: found without being told, transients cut, noise unbiased, derivatives from the lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from robot_ident.errors import InputError
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.period import find_period
from robot_ident.recording.summary import summarise
from robot_ident.signals.fourier import evaluate, fit_lines, lines_of_grid


@pytest.mark.parametrize("periods", [2, 3, 16])
def test_period_and_steady_part_are_found(arm: Any, periods: int) -> None:
    measured = process(arm.record(1, periods=periods), arm.robot)
    assert measured.periods == periods
    assert measured.base_frequency == pytest.approx(0.1, rel=1e-9)
    assert measured.samples_per_period == 1500


@pytest.mark.parametrize("pause", [0.0, 40.0])
def test_a_joint_that_is_held_hides_no_period(arm: Any, pause: float) -> None:
    """What its encoder shows is noise, which repeats with no period and moves as long as the recording lasts."""
    recording = arm.record(1, periods=4)
    flicker = np.random.default_rng(1).normal(0.3, 4e-5, recording.samples + round(pause * 150))
    last = np.full(len(flicker) - recording.samples, recording.samples - 1)
    rows = np.concatenate([np.arange(recording.samples), last])
    q = recording.q[rows] + np.random.default_rng(2).normal(0.0, 1e-5, (len(rows), 3))
    q[:, 0] = flicker
    t = recording.t[0] + np.arange(len(rows)) / 150
    measured = process(replace(recording, t=t, q=q, tau=recording.tau[rows], dq=None), arm.robot)
    assert measured.periods in (3, 4)  # the arm stops at once where it stops
    assert measured.base_frequency == pytest.approx(0.1, rel=1e-6)
    assert measured.position_variance[0] == pytest.approx(16e-10, rel=0.1)


@pytest.mark.parametrize(("reach", "noise"), [(0.0034, 0.0002), (0.03, 0.002), (0.0034, 0.0)])
def test_a_joint_that_hardly_moves_tells_the_period_all_the_same(reach: float, noise: float) -> None:
    """The others repeat after half of it."""
    t = np.arange(0.0, 40.0, 0.01)
    q = np.column_stack([np.sin(2 * np.pi * 0.2 * t), reach * np.sin(2 * np.pi * 0.1 * t), np.cos(2 * np.pi * 0.4 * t)])
    q += np.random.default_rng(3).normal(0.0, 1.0, q.shape) * np.array([1e-5, noise, 1e-5])
    assert find_period(q, 0.01) == pytest.approx(1000.0, rel=1e-4)


def test_the_period_of_a_long_recording_is_no_multiple_of_it() -> None:
    rng = np.random.default_rng(3)
    t = np.arange(600_000) / 1000.0
    w = 2.0 * np.pi / 0.7
    q = np.column_stack([np.sin(w * t) + 0.3 * np.cos(3 * w * t), 0.4 * np.cos(w * t), np.sin(0.25 * w * t)])
    q = np.vstack([np.tile(q[0], (50_000, 1)), q]) + 1e-4 * rng.standard_normal((650_000, 3))
    assert find_period(q, 1e-3) == pytest.approx(2800.0, rel=1e-5), "the third joint needs four of the others' periods"
    assert find_period(q[:, :2], 1e-3) == pytest.approx(700.0, rel=1e-5)


def test_what_repeats_at_first_alone_has_no_period_of_the_whole() -> None:
    t = np.arange(900_000) / 1000.0
    q = np.column_stack([np.sin(2 * np.pi * t), np.cos(2 * np.pi * t)])
    q[150_000:] = np.column_stack([np.sin((t[150_000:] / 7.0) ** 1.7), np.cos((t[150_000:] / 9.0) ** 1.6)])
    assert find_period(q, 1e-3) is None


def test_a_joint_that_creeps_hides_no_period() -> None:
    t = np.arange(0.0, 50.0, 0.01)
    q = np.column_stack([np.sin(2 * np.pi * 0.1 * t), 1e-4 * t])
    q += np.random.default_rng(3).normal(0.0, 1e-5, q.shape)
    assert find_period(q, 0.01) == pytest.approx(1000.0, rel=1e-4)


def test_motion_is_the_true_one_far_below_the_encoder(arm: Any) -> None:
    measured = process(arm.record(2), arm.robot)
    t = arm.record(2).t
    first = t[-1] - 1000.0 - (16 * 1500 - 1) / 150  # the averaged periods end with the recording
    exact = arm.series.motion(first + np.arange(1500) / 150)
    assert np.abs(measured.motion.q - exact.q).max() < 5e-6
    assert np.abs(measured.motion.dq - exact.dq).max() < 2e-5
    assert np.abs(measured.motion.ddq - exact.ddq).max() < 1e-4


def test_noise_variance_is_unbiased_over_many_recordings(arm: Any) -> None:
    ratios = [
        process(arm.record(seed, periods=3, lead=0.0), arm.robot).torque_variance / arm.robot.noise.torque_variance
        for seed in range(40)
    ]
    # 40 recordings x 3000 degrees of freedom x 3 joints: 4 sigma of the mean ratio is 4 sqrt(2 / 360000)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 360_000))


@pytest.mark.parametrize(
    "options", [{"dropped": 0.03}, {"late": 1e-3}, {"jitter": 1e-3}, {"rate": 133.7}, {"rate": 512.3, "periods": 3}]
)
def test_noise_is_right_on_uneven_and_holed_recordings(arm: Any, options: dict[str, float]) -> None:
    measured = process(arm.record(7, **options), arm.robot)
    assert measured.base_frequency == pytest.approx(0.1, rel=1e-6)
    spread = 5 * np.sqrt(2 / measured.variance_dof)
    np.testing.assert_allclose(measured.torque_variance / arm.robot.noise.torque_variance, 1.0, atol=spread)
    exact = arm.structure.columns(measured.motion) @ arm.structure.true_values()
    residual = np.where(measured.used, measured.passed(measured.torque - exact), np.nan)
    chi = np.nanmean(residual**2, axis=0) / measured.averaged_variance
    independent = measured.motion.samples * measured.independent
    np.testing.assert_allclose(chi, 1.0, atol=5 * np.sqrt(2 / independent))


def test_base_frequency_of_another_trajectory_is_refused(arm: Any) -> None:
    with pytest.raises(InputError, match=r"repeats every 10 s, not every 8"):
        process(arm.record(1), arm.robot, Processing(base_frequency=0.12, periodic=True))


def test_fewer_than_two_periods_are_refused_where_periods_are_needed(arm: Any) -> None:
    recording = arm.record(1, periods=2, lead=0.0)[slice(0, 2200)]
    with pytest.raises(InputError, match="at least 2"):
        process(recording, arm.robot, Processing(base_frequency=0.1, periodic=True))


def test_motion_that_does_not_repeat_has_no_period() -> None:
    t = np.arange(6000) / 150.0
    walk = np.cumsum(np.cumsum(np.random.default_rng(0).normal(size=(6000, 2)), axis=0), axis=0)
    assert find_period(walk / np.abs(walk).max(), 1 / 150) is None
    assert find_period(np.column_stack([np.sin(t**1.3), np.cos(0.7 * t**1.2)]), 1 / 150) is None


def test_least_squares_lines_are_those_of_the_grid() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(201, 2))
    t = np.arange(201) / 201 * 4.0
    np.testing.assert_allclose(fit_lines(t, x, 0.25, 100), lines_of_grid(x), atol=1e-10)
    np.testing.assert_allclose(evaluate(lines_of_grid(x), 201, 0.25), x, atol=1e-12)


def test_line_derivatives_are_the_signals() -> None:
    t = np.arange(300) / 300 * 10.0
    w = 2 * np.pi * 0.1
    x = np.column_stack([np.sin(3 * w * t), 1 + np.cos(w * t)])
    lines = lines_of_grid(x)
    first = np.column_stack([3 * w * np.cos(3 * w * t), -w * np.sin(w * t)])
    np.testing.assert_allclose(evaluate(lines, 300, 0.1, 1), first, atol=1e-9)


def test_low_pass_counts_the_noise_that_passes(arm: Any) -> None:
    shares = []
    for seed in range(10):
        measured = process(arm.record(seed), arm.robot, Processing(low_pass=10.0))
        exact = arm.structure.columns(measured.motion) @ arm.structure.true_values()
        passed = measured.passed(measured.torque - exact)
        shares.append(np.mean(passed**2, axis=0) / measured.averaged_variance)
    # 201 independent values a joint and recording
    assert np.mean(shares) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (201 * 30)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda r: {"q": np.degrees(r.q)}, "degrees instead of radians"),
        (lambda r: {"tau": 0 * r.tau}, "every torque is zero"),
        (lambda r: {"q": 0 * r.q + 0.1}, "no joint moves"),
        (lambda r: {"tau": 1e4 * r.tau}, "wrong units"),
        (lambda r: {"names": ("a", "joint_2", "joint_3")}, "'joint_1' is missing"),
    ],
)
def test_implausible_recordings_are_one_line(arm: Any, change: Any, words: str) -> None:
    r = arm.record(1, periods=2)
    fields = {"names": r.names, "t": r.t, "q": r.q, "tau": r.tau, "source": "x.csv", **change(r)}
    with pytest.raises(InputError, match=words):
        process(Recording(**fields), arm.robot)


def test_nan_is_refused_with_its_place(arm: Any) -> None:
    r = arm.record(1, periods=2)
    q = np.array(r.q)
    q[17, 1] = np.nan
    with pytest.raises(InputError, match="q is not a number in 1 of"):
        Recording(r.names, r.t, q, r.tau)


def test_summary_says_what_is_there(arm: Any) -> None:
    summary = summarise(arm.record(1, periods=4))
    assert summary.periods == 4
    assert summary.period == pytest.approx(10.0)
    assert summary.rate == pytest.approx(150.0, rel=1e-6)
    assert summary.torque_variance is not None
    np.testing.assert_allclose(summary.torque_variance, [400, 416, 160], rtol=0.15)


@pytest.mark.parametrize(("before", "after"), [(60.0, 0.0), (0.0, 60.0), (45.0, 45.0)])
def test_a_long_rest_is_no_period(arm: Any, before: float, after: float) -> None:
    r = arm.record(3, periods=3)
    rate, rng = 150, np.random.default_rng(0)
    head, tail = (round(rate * seconds) for seconds in (before, after))
    pad = lambda x, noise: np.concatenate(  # noqa: E731
        [
            x[0] + noise * rng.normal(size=(head, 3)),
            x,
            x[-1] + noise * rng.normal(size=(tail, 3)),
        ]
    )
    t = np.arange(head + r.samples + tail) / rate
    measured = process(Recording(r.names, t, pad(r.q, 4e-5), pad(r.tau, 20.0)), arm.robot)
    assert measured.periods == 3
    assert measured.base_frequency == pytest.approx(0.1, rel=1e-6)


def test_what_is_left_out_before_the_periods_is_named(arm: Any) -> None:
    """Four periods, then nothing for 100 s and two thirds of a period, then ten periods."""
    r = arm.record(1, periods=14, lead=0.0)
    late = np.arange(r.samples) >= 6000
    paused = replace(r, t=r.t + 106.7 * late)
    notes = process(paused, arm.robot, Processing(periodic=True)).notes
    told = next(note for note in notes if "left out" in note)
    assert "before the periods left out: no samples for 106.7 s from 39.99 s on" in told, notes
    assert "4 periods that are not in step with the others" in told or "3 periods that" in told
    usual = process(arm.record(1, periods=4, lead=7.3), arm.robot).notes
    assert any("of approach and transient left out" in note for note in usual)


def test_a_mean_effort_that_drifts_is_named(arm: Any) -> None:
    """An offset that changes goes into the parameters of weight; noise alone doesn't look like one."""
    recordings = [arm.record(seed, periods=8) for seed in range(6)]
    assert not any("drifts" in note for one in recordings for note in process(one, arm.robot).notes)
    first = recordings[0]
    rise = np.linspace(0.0, 10.0, first.samples)[:, None] * [0.0, 1.0, 0.0]
    (note,) = [n for n in process(replace(first, tau=first.tau + rise), arm.robot).notes if "drifts" in n]
    size = float(note.split("drifts by ")[1].split()[0])
    assert "joint_2" in note and size == pytest.approx(10.0 * 7 / 8, rel=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_periods_scatter_slowly_where_friction_differs_from_one_to_the_next(arm: Any, seed: int) -> None:
    """What a servo makes of friction's noise lasts a tenth of a second, far above that of an encoder: one brief window
    in a thousand of it is no other motion, and no period is lost.
    """
    recording = arm.record(seed, lead=0.0)
    slow = gaussian_filter1d(np.random.default_rng(seed).normal(size=recording.q.shape), 15.0, axis=0)
    shaken = replace(recording, q=recording.q + 6e-4 * slow / slow.std())
    assert process(shaken, arm.robot).periods >= 15
