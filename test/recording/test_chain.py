"""The measuring chain: filters and delays undone exactly, current turned into torque, noise and rounding counted."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import signal

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.torque_channel import Chain
from robot_ident.robot.robot import AntiAlias, Definition
from robot_ident.robot.robot_file import definition_of, robot_of

PAPER = AntiAlias(8, 40.0)
FINE = 20  # steps of the analogue filter's simulation a sample


def recorded(arm: Any, seed: int, *, filtered: bool, periods: int = 16, lead: float = 0.0) -> Recording:
    """Record noise that is white to half of the sample rate, in front of the filter, the same with and without it."""
    rng = np.random.default_rng(seed)
    samples = round((lead + 10.0 * periods) * 150)
    noise = rng.normal(size=(samples, 3)) * np.sqrt(arm.robot.noise.torque_variance)
    t = np.arange(samples) / 150.0 - lead
    q = arm.series.motion(t).q + rng.normal(size=noise.shape) * np.sqrt(arm.robot.noise.position_variance)
    if filtered:
        fine = np.arange(samples * FINE) / (150.0 * FINE) - lead
        one = arm.structure.columns(arm.series.motion(fine[: 1500 * FINE])) @ arm.structure.true_values()
        exact = np.tile(one, (samples // 1500 + 1, 1))[: len(fine)]
        smooth = np.fft.irfft(np.fft.rfft(noise, axis=0), samples * FINE, axis=0) * FINE
        sections = signal.butter(PAPER.order, PAPER.cutoff, fs=150.0 * FINE, output="sos")
        first = signal.sosfilt_zi(sections)[:, :, None] * exact[0]
        tau = signal.sosfilt(sections, exact + smooth, axis=0, zi=first)[0][::FINE]
    else:
        tau = arm.structure.columns(arm.series.motion(t)) @ arm.structure.true_values() + noise
    return Recording(arm.robot.joints, t, q, tau, source="filtered" if filtered else "plain")


def test_response_is_butterworths() -> None:
    frequency = np.array([0.0, 5.0, 39.0, 40.0, 60.0])
    for order in (1, 4, 7, 8):
        analogue = signal.butter(order, 2 * np.pi * 40.0, analog=True)
        expected = signal.freqs(*analogue, 2 * np.pi * frequency)[1]
        chain = Chain((AntiAlias(order, 40.0),) * 2, np.zeros(2))
        np.testing.assert_allclose(chain.response(frequency)[:, 1], expected, atol=1e-12)
        assert abs(chain.response(np.array([chain.bandwidth]))[0, 0]) == pytest.approx(0.5)


def test_joints_have_filters_of_their_own(arm: Any) -> None:
    """One joint's filter is undone there, and leaves the others' torque as it is; the slowest one bounds the band."""
    chain = Chain((None, AntiAlias(2, 8.0), AntiAlias(8, 40.0)), np.array([0.0, 0.0, 0.01]))
    frequency = np.array([1.0, 4.0, 8.0])
    response = chain.response(frequency)
    np.testing.assert_array_equal(response[:, 0], 1.0)
    assert np.abs(response[2, 1]) == pytest.approx(np.sqrt(0.5))
    assert np.angle(response[0, 2]) < -2.0 * np.pi * 0.01
    assert chain.bandwidth == pytest.approx(8.0 * 3.0**0.25)
    known = definition_of(arm.robot)
    joints = {**known.yaml["joints"], "joint_2": {**known.yaml["joints"]["joint_2"], "anti_alias": {"cutoff": 8.0}}}
    robot = robot_of(Definition({**known.yaml, "joints": joints, "anti_alias": {"cutoff": 40.0}}, known.urdf), "arm")
    assert robot.anti_alias == (AntiAlias(8, 40.0), AntiAlias(8, 8.0), AntiAlias(8, 40.0))


def test_parameters_through_the_filter_are_those_without_it(arm: Any) -> None:
    robot = replace(arm.robot, anti_alias=(PAPER,) * 3)
    plain = identify([recorded(arm, 1, filtered=False)], arm.robot)
    undone = identify([recorded(arm, 1, filtered=True)], robot)
    assert np.abs((undone.values - plain.values) / plain.std).max() < 0.3
    np.testing.assert_allclose(undone.std, plain.std, rtol=0.1)
    for fit in undone.residual.values():
        assert fit.noise_variance is not None
        assert fit.mse / fit.noise_variance == pytest.approx(1.0, abs=0.2)
    assert any("order 8 at 40 Hz undone" in note for note in undone.notes)


def test_noise_variance_behind_the_filter_is_that_in_front_of_it(arm: Any) -> None:
    measured = process(recorded(arm, 2, filtered=True), arm.robot, Processing(anti_alias=(8, 40.0)))
    np.testing.assert_allclose(measured.torque_variance / arm.robot.noise.torque_variance, 1.0, atol=0.04)


def test_the_filter_forgotten_is_a_delay_that_shows(arm: Any) -> None:
    model = identify([recorded(arm, 1, filtered=True)], arm.robot)
    truth = arm.structure.true_values()
    assert np.abs((model.values - truth) / np.sqrt(np.diag(model.by_noise))).max() > 10
    assert any("residual exceeds the noise" in note for note in model.notes)


def test_option_replaces_what_the_robot_declares(arm: Any) -> None:
    robot = replace(arm.robot, anti_alias=(PAPER,) * 3)
    plain = recorded(arm, 3, filtered=False, periods=4)
    off = identify([plain], robot, processing=Processing(anti_alias=(0, 0)))
    np.testing.assert_array_equal(off.values, identify([plain], arm.robot).values)


def test_filter_on_one_pass(arm: Any) -> None:
    once = Processing(periodic=False, low_pass=10.0)
    plain = identify([recorded(arm, 4, filtered=False, periods=2)], arm.robot, processing=once)
    undone = identify(
        [recorded(arm, 4, filtered=True, periods=2)], replace(arm.robot, anti_alias=(PAPER,) * 3), processing=once
    )
    assert np.abs((undone.values - plain.values) / plain.std).max() < 0.3


def test_delay_between_channels_is_undone(arm: Any) -> None:
    delay = np.array([0.004, -0.006, 0.02])
    t = np.arange(9000) / 150.0
    q = arm.series.motion(t).q
    rng = np.random.default_rng(0)
    tau = np.empty_like(q)
    for joint in range(3):
        late = arm.structure.columns(arm.series.motion(t - delay[joint])) @ arm.structure.true_values()
        tau[:, joint] = late[:, joint]
    tau += rng.normal(size=tau.shape) * 3.0
    recording = Recording(arm.robot.joints, t, q, tau)
    model = identify([recording], replace(arm.robot, torque_delay=delay))
    error = model.values - arm.structure.true_values()
    assert np.abs(error / model.std).max() < 4.5
    forgotten = identify([recording], arm.robot)
    assert np.abs((forgotten.values - arm.structure.true_values()) / forgotten.std).max() > 10


@pytest.mark.parametrize("order", [1, 8, 12])
@pytest.mark.parametrize("periodic", [True, False])
def test_a_filter_that_leaves_nothing_of_the_motion_is_refused(arm: Any, order: int, periodic: bool) -> None:
    processing = Processing(anti_alias=(order, 1e-9), periodic=periodic)
    with pytest.raises(InputError, match="passes less than half above .*, and the motion begins at"):
        process(arm.record(0, periods=2), arm.robot, processing)


def test_a_filter_that_the_sampling_could_not_follow_is_refused(arm: Any) -> None:
    with pytest.raises(InputError, match="cutoff of 90 Hz is not below half the sample rate, 75 Hz"):
        process(arm.record(0, periods=2), arm.robot, Processing(anti_alias=(8, 90.0)))


def test_rounding_that_does_not_average_out_is_counted(arm: Any) -> None:
    r = arm.record(0, periods=8, lead=0.0, noise=0.0)
    coarse = Recording(r.names, r.t, r.q, np.round(r.tau / 2.0) * 2.0)
    measured = process(coarse, arm.robot)
    assert measured.quantisation is not None
    exact = arm.structure.columns(measured.motion) @ arm.structure.true_values()
    error = np.mean((measured.torque - exact) ** 2, axis=0)
    np.testing.assert_allclose(measured.averaged_variance, error, rtol=0.25)
    noisy = process(arm.record(0, periods=4), arm.robot)
    assert noisy.quantisation is None or np.all(noisy.quantisation < 1e-6)
