"""The whole simulation: what is recorded, how exactly, how noisily, and that it can be had again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.simulation import simulate

PERIOD, RATE = 4.0, 150.0


def true_torque(robot: Robot, motion: Motion) -> np.ndarray:
    """Return Pinocchio's inverse dynamics and the friction of the robot's description."""
    tau = robot.rigid.inverse_dynamics(motion)
    for joint, values in robot.simulation["viscous"].items():
        tau[:, robot.joint_index(joint)] += values["viscous"] * motion.dq[:, robot.joint_index(joint)]
    for joint, values in robot.simulation["coulomb"].items():
        tau[:, robot.joint_index(joint)] += values["coulomb"] * np.sign(motion.dq[:, robot.joint_index(joint)])
    return tau


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_torque_belongs_to_the_motion(kuka: Robot, blend) -> None:
    """The recorded torque is the inverse dynamics of the exact motion, of the reference, and of the positions alone."""
    reference = blend(kuka, 2 * PERIOD)
    fine = simulate(kuka, reference, sample_rate=1500.0, step_rate=1500.0)
    moving = np.abs(fine.exact.dq) > 0.02
    off = fine.torque - true_torque(kuka, fine.exact)
    at = reference.reference(fine.recording.t)
    off_reference = fine.torque - true_torque(kuka, at)
    h = 1 / 1500
    q = fine.exact.q
    derived = Motion(q[1:-1], (q[2:] - q[:-2]) / (2 * h), (q[2:] - 2 * q[1:-1] + q[:-2]) / h**2)
    off_derived = fine.torque[1:-1] - true_torque(kuka, derived)
    for j in range(3):
        assert rms(off[moving[:, j], j]) < 1e-9
        assert rms(off_reference[moving[:, j], j]) < 0.03
        assert rms(off_derived[moving[1:-1, j], j]) < 0.3
    assert np.abs(fine.exact.q - at.q).max() < 1e-6


def test_no_reversal_is_smeared(kuka: Robot, blend) -> None:
    """All samples count, those beside reversals too: mean square far below a hundredth of the noise."""
    result = simulate(kuka, blend(kuka, 3 * PERIOD), steady=(PERIOD, PERIOD, 2))
    steady = slice(int(PERIOD * RATE), None)
    off = (result.torque - true_torque(kuka, result.exact))[steady]
    noise = kuka.noise.torque_variance / 16
    assert np.count_nonzero(np.diff(np.sign(result.exact.dq[steady]), axis=0)) > 10
    assert np.all(np.mean(off**2, axis=0) < 1e-4 * noise)
    assert not np.any(result.exact.dq[steady] == 0)


def test_pd_sticks_and_lags(kuka: Robot, blend) -> None:
    reference = blend(kuka, 2 * PERIOD)
    result = simulate(kuka, reference, servo="pd")
    error = np.abs(result.exact.q - reference.reference(result.recording.t).q)[300:]
    assert np.all(error.max(axis=0) > 3e-4)
    assert error.max() < 0.05
    sticks = result.exact.dq[300:] == 0
    assert sticks.any()
    moving = np.abs(result.exact.dq) > 0.02
    off = result.torque - true_torque(kuka, result.exact)
    assert all(rms(off[moving[:, j], j]) < 1e-9 for j in range(3))
    assert np.all(np.abs(result.exact.ddq[300:][sticks]) == 0)


@pytest.mark.parametrize("servo", ["feedforward", "pd"])
def test_a_repeated_period_is_what_brute_force_gives(kuka: Robot, blend, servo: str) -> None:
    reference = blend(kuka, 5 * PERIOD)
    repeated = simulate(kuka, reference, steady=(PERIOD, PERIOD, 4), servo=servo)
    brute = simulate(kuka, reference, servo=servo)
    rows = len(repeated.recording.t)
    assert rows == 5 * PERIOD * RATE
    np.testing.assert_allclose(repeated.recording.t, brute.recording.t[:rows], atol=1e-12)
    np.testing.assert_allclose(repeated.exact.q, brute.exact.q[:rows], atol=1e-8)
    np.testing.assert_allclose(repeated.torque, brute.torque[:rows], atol=0.01)


def test_every_period_has_noise_of_its_own(kuka: Robot, blend) -> None:
    result = simulate(kuka, blend(kuka, 0.0), steady=(PERIOD, PERIOD, 16))
    n = int(PERIOD * RATE)
    periods = result.recording.tau[n:].reshape(16, n, 3)
    np.testing.assert_array_equal(result.torque[-2 * n : -n], result.torque[-n:])
    np.testing.assert_allclose(periods.var(axis=0, ddof=1).mean(axis=0), [400, 416, 160], rtol=0.05)
    assert (
        abs(np.corrcoef((periods[0] - periods.mean(0))[:, 0], (periods[1] - periods.mean(0))[:, 0])[0, 1] + 1 / 15)
        < 0.15
    )


def test_noise_and_quantisation_have_the_stated_size(kuka: Robot, blend) -> None:
    result = simulate(kuka, blend(kuka, 0.0), steady=(PERIOD, PERIOD, 40))
    recording, step = result.recording, kuka.drives.encoder_step
    np.testing.assert_allclose((recording.tau - result.torque).var(axis=0), [400, 416, 160], rtol=0.04)
    expected = kuka.noise.position_variance + step**2 / 12
    np.testing.assert_allclose((recording.q - result.exact.q).var(axis=0), expected, rtol=0.04)
    np.testing.assert_allclose(recording.q / step, np.round(recording.q / step), atol=1e-6)
    assert recording.dq is not None
    np.testing.assert_allclose((recording.dq - result.exact.dq).std(axis=0), np.sqrt(2 * expected) * RATE, rtol=0.04)
    np.testing.assert_array_equal(recording.names, kuka.joints)


def test_unknown_noise_is_none(arm: Robot, blend) -> None:
    result = simulate(arm, blend(arm, 1.0), sample_rate=100.0)
    np.testing.assert_array_equal(result.recording.tau, result.torque)
    np.testing.assert_array_equal(result.recording.q, result.exact.q)
    off = np.abs(result.exact.q - blend(arm, 1.0).reference(result.recording.t).q)
    assert off.max() < 1e-4


def test_same_seed_same_recording(kuka: Robot, blend) -> None:
    first, again, other = (simulate(kuka, blend(kuka, 1.0), seed=seed).recording for seed in (5, 5, 6))
    for field in ("t", "q", "dq", "tau"):
        np.testing.assert_array_equal(getattr(first, field), getattr(again, field))
    assert np.any(first.tau != other.tau)


def test_noise_factor(kuka: Robot, blend) -> None:
    full, quarter = (simulate(kuka, blend(kuka, 1.0), noise=noise) for noise in (1.0, 0.25))
    np.testing.assert_allclose(
        quarter.recording.tau - quarter.torque, (full.recording.tau - full.torque) / 2, atol=1e-9
    )


def test_anti_alias_filter_delays_by_twenty_milliseconds(kuka: Robot, blend) -> None:
    """The filter delays the torque, and what is left of the noise is its share of the band."""
    steady = (PERIOD, PERIOD, 30)
    result = simulate(kuka, blend(kuka, 0.0), steady=steady, anti_alias=True)
    quiet = simulate(kuka, blend(kuka, 0.0), steady=steady, anti_alias=True, noise=0.0)
    t, smooth = result.recording.t, quiet.recording.tau[:, 1]
    delays = np.linspace(0.0, 0.04, 81)
    misfit = [rms(np.interp(t[900:-900] - d, t, quiet.torque[:, 1]) - smooth[900:-900]) for d in delays]
    assert delays[int(np.argmin(misfit))] == pytest.approx(0.0205, abs=0.0011)
    left = (result.recording.tau - quiet.recording.tau).var(axis=0)
    np.testing.assert_allclose(left / [400, 416, 160], 40.0 * 1.0064 / 75.0, rtol=0.06)


def test_hidden_effect_is_unknown_to_the_servo(kuka: Robot, blend) -> None:
    plain = simulate(kuka, blend(kuka, 2 * PERIOD))
    hidden = simulate(kuka, blend(kuka, 2 * PERIOD), effects=["torque_offset@joint_2:8", "rotor_inertia@joint_3:2"])
    assert hidden.effects[-2:] == ("torque_offset@joint_2", "rotor_inertia@joint_3")
    late = slice(300, None)
    difference = (hidden.torque - plain.torque)[late]
    assert np.median(difference[:, 1]) == pytest.approx(8.0, abs=0.3)
    ddq = plain.exact.ddq[late, 2]
    assert np.polyfit(ddq, difference[:, 2], 1)[0] == pytest.approx(2.0, abs=0.1)
    assert np.abs(hidden.exact.q - plain.exact.q).max() > 1e-5


def test_torque_limit_is_kept_and_said(kuka: Robot, blend) -> None:
    weak = replace(kuka, limits=replace(kuka.limits, torque=np.array([60.0, 443.0, 223.0])))
    result = simulate(weak, blend(weak, 2 * PERIOD), servo="pd")
    assert np.abs(result.torque[:, 0]).max() == 60.0
    assert len(result.notes) == 1
    assert "joint_1 is at its torque limit 60 Nm" in result.notes[0]


def test_friction_that_replaces_the_robots(kuka: Robot) -> None:
    assert {p.label for p in plant_physics(kuka, ["coulomb@joint_1:0"])} == {p.label for p in plant_physics(kuka)}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"servo": "feedfoward"}, "did you mean 'feedforward'"),
        ({"step_rate": 1000.0}, "1000 Hz is not a multiple of the sample rate 150 Hz"),
        ({"sample_rate": 0.0}, "sample rate 0.0 Hz"),
        ({"steady": (4.0, 4.0, 0)}, "0 periods"),
        ({"noise": -1.0}, "noise -1.0"),
        ({"bandwidth": -1.0}, "bandwidth"),
        ({"effects": ["nothing@joint_1"]}, "knows no effect 'nothing'"),
    ],
)
def test_impossible_wishes_are_refused(kuka: Robot, blend, options, message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(kuka, blend(kuka, 1.0), **options)


def test_a_motion_of_another_robot_is_refused(kuka: Robot, arm: Robot, blend) -> None:
    with pytest.raises(InputError, match=f"moves {arm.n} joints, robot kuka_ir361 has 3"):
        simulate(kuka, blend(arm, 1.0))
