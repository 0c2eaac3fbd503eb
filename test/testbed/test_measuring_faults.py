"""Faults of measuring that trials hide: each does to a recording what it says, by means apart from diagnosis."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

from robot_ident.recording import Recording
from robot_ident.robot import Robot
from robot_ident.testbed.faulty_recordings import FAULTS, draw_fault, fault_of, recordings_with

RATE = 150.0


def recording(f: float = 2.0, samples: int = 3000) -> Recording:
    t = np.arange(samples) / RATE
    q = np.column_stack([np.sin(2 * np.pi * f * t + k) for k in range(3)])
    return Recording(("joint_1", "joint_2", "joint_3"), t, q, 10.0 * q)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_text_says_all(kuka: Robot) -> None:
    for seed in range(20):
        fault = draw_fault(seed, kuka, 3)
        assert fault_of(fault.text(kuka), kuka) == fault
        assert draw_fault(seed, kuka, 3) == fault
    assert {draw_fault(seed, kuka, 3).name for seed in range(40)} == set(FAULTS)


def test_a_gain_is_of_one_joint(kuka: Robot) -> None:
    whole = recording()
    made = fault_of("effort_gain@joint_2:gain=-1.0", kuka).written(whole, rng())
    np.testing.assert_array_equal(made.tau, whole.tau * [1, -1, 1])
    np.testing.assert_array_equal(made.q, whole.q)


@pytest.mark.parametrize("order", [1, 2])
def test_a_filter_halves_the_power_at_its_cutoff(kuka: Robot, order: int) -> None:
    whole = recording(f=5.0)
    made = fault_of(f"effort_filter@joint_1:cutoff=5.0,order={order}.0", kuka).written(whole, rng())
    late = slice(1500, None)
    assert np.std(made.tau[late, 0]) == pytest.approx(np.std(whole.tau[late, 0]) / np.sqrt(2), rel=0.01)
    np.testing.assert_array_equal(made.tau[:, 1:], whole.tau[:, 1:])


def test_stamps_come_late_and_none_overtakes(kuka: Robot) -> None:
    whole = recording()
    made = fault_of("stamp_jitter:jitter=0.005,late=1.0", kuka).written(whole, rng())
    late = made.t - whole.t
    assert np.all(np.diff(made.t) > 0)
    assert late.min() > -1e-9 - 1e-6 * 3000
    assert np.std(late) == pytest.approx(0.005, rel=0.25)
    np.testing.assert_array_equal(made.q, whole.q)


def test_a_joint_stands_elsewhere(kuka: Robot) -> None:
    fault = fault_of("link_length@joint_2:x=0.01,y=0.0,z=-0.02", kuka)
    true = fault.plant(kuka)
    moved = [m.jointPlacements[2].translation.copy() for m in (true.rigid.model, kuka.rigid.model)]
    np.testing.assert_allclose(moved[0] - moved[1], [0.01, 0.0, -0.02])
    q, data = np.array([0.3, 0.4, -0.2]), true.rigid.model.createData()
    pinocchio.forwardKinematics(true.rigid.model, data, q)
    assert true.joints == kuka.joints


def test_a_load_is_in_one_recording_alone(kuka: Robot, blend) -> None:
    fault = fault_of("payload:payload=5.0,x=0.0,y=0.0,z=0.0,recording=1.0", kuka)
    assert fault.effects(kuka, 0) == ()
    (text,) = fault.effects(kuka, 1)
    assert text.startswith("payload:payload=5.0")


def test_recordings_are_whole_periods(kuka: Robot) -> None:
    from robot_ident.trajectories.fourier_series import FourierSeries

    a, b = 0.2 * np.random.default_rng(1).standard_normal((2, 3, 5))
    motions = [FourierSeries(0.1, np.zeros(3), a, b)]
    fault = fault_of("effort_filter:cutoff=4.0,order=2.0", kuka)
    (made,) = recordings_with(fault, kuka, motions, periods=2, noise=0.0)
    assert made.samples == 2 * 1500
    np.testing.assert_allclose(made.tau[:1500], made.tau[1500:], atol=1e-6 * np.abs(made.tau).max())
