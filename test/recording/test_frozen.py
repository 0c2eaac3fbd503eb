"""Efforts that stop while their joint moves on count for nothing; coarse and saturated ones, brakes and rests stay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate, identify
from robot_ident.estimation.validation import moving_rows, validate
from robot_ident.planning.validation_motion import moves
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.frozen import find_frozen
from robot_ident.recording.summary import summarise

POINTS = np.array([[0, 0, 0], [1, 0.5, -0.5], [0.3, -0.4, 0.8], [-1, 0.2, 0.1], [0, 0, 0]] * 6)


def frozen(recording: Recording, joints: list[int], begin: float, seconds: float, value: float | None) -> Recording:
    """Return a recording in which some efforts stand from an instant on, at a value or at what they are there."""
    t, tau = recording.t - recording.t[0], np.array(recording.tau)
    rows = (t >= begin) & (t < begin + seconds)
    tau[np.ix_(rows, joints)] = tau[rows][0, joints] if value is None else value
    return replace(recording, tau=tau, source="f.npz")


@pytest.mark.parametrize("periodic", [None, False])
@pytest.mark.parametrize("value", [None, 0.0])
@pytest.mark.parametrize("joints", [[1], [0, 1, 2]])
@pytest.mark.parametrize("periods", [3, 8])
def test_estimates_are_true(
    arm: Any, periods: int, joints: list[int], value: float | None, periodic: bool | None
) -> None:
    """In one pass, in the mean of so few periods that all count, and of so many that the odd one is left out."""
    whole = arm.record(1, periods=periods)
    spoilt = frozen(whole, joints, 20.0, 2.0, value)
    asked = Processing(periodic=periodic)
    measured, plain = process(spoilt, arm.robot, asked), process(whole, arm.robot, asked)
    notes = [note for note in measured.notes if "these rows do not count" in note]
    assert len(notes) == len(joints)
    assert " Nm for 2.0 s from 1012.70 s on while the joint moves: these rows" in notes[0]
    others = np.setdiff1d(np.arange(3), joints)
    np.testing.assert_array_equal(measured.used[:, others], plain.used[:, others])
    found = estimate([measured, process(arm.record(2, periods=periods), arm.robot, asked)], arm.structure)
    assert np.abs((found.values - arm.structure.true_values()) / found.std).max() < 3.5
    for joint in joints:
        assert notes[joints.index(joint)] in [n.replace(" for 2.0", " Nm for 2.0") for n in summarise(spoilt).notes]


def test_validation_leaves_out_the_same_rows(arm: Any) -> None:
    """Neither while moving nor near standstill does a frozen effort count as the model's error."""
    model = identify([arm.record(1, periods=8)], arm.robot)
    whole = arm.record(3, periods=3)
    spoilt = frozen(whole, [1], 20.0, 4.0, 0.0)
    asked = Processing(periodic=False)
    lost = moving_rows(process(whole, arm.robot, asked)) & ~moving_rows(process(spoilt, arm.robot, asked))
    assert not lost[:, [0, 2]].any()
    assert 300 < lost[:, 1].sum() < 660
    plain, found = validate(model, whole), validate(model, spoilt)
    for before, after in ((plain.residual, found.residual), (plain.standstill, found.standstill)):
        assert after["joint_2"].rms < 1.2 * before["joint_2"].rms
    assert any("stands at 0 Nm for 4.0 s" in note for note in found.notes)


def test_where_too_little_is_left(arm: Any) -> None:
    spoilt = frozen(arm.record(1, periods=3, lead=0.0), [1], 2.0, 23.0, None)
    with pytest.raises(InputError, match=r"f.npz: the effort of joint_2 stands at .* too little of the motion is left"):
        process(spoilt, arm.robot, Processing(periodic=False))


@pytest.mark.parametrize("rate", [50.0, 150.0, 1000.0])
@pytest.mark.parametrize("levels", [3, 4, 6, 12, 50])
@pytest.mark.parametrize("noise", [0.0, 0.02, 0.2, 1.0])
def test_coarse_efforts_are_not_frozen(arm: Any, rate: float, levels: int, noise: float) -> None:
    """Of a few levels, with noise from none to much of a step; published at every sample, and at one in five."""
    whole = arm.record(1, periods=3, rate=rate, noise=noise)
    step = np.ptp(whole.tau, axis=0) / levels
    coarse = np.round(whole.tau / step) * step
    slow = np.repeat(coarse[::5], 5, axis=0)[: whole.samples]
    for tau in (coarse, slow):
        assert find_frozen(replace(whole, tau=tau))[1] == {}


@pytest.mark.parametrize("rate", [30.0, 150.0])
@pytest.mark.parametrize("levels", [2, 4, 8, 20, 80])
@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
def test_coarse_efforts_of_slow_motions_are_not_frozen(arm: Any, rate: float, levels: int, noise: float) -> None:
    """Noise takes such an effort to and fro at the edge of a step only; within it stands for seconds."""
    slow = replace(arm, series=replace(arm.series, base_frequency=0.02)).record(1, periods=2, rate=rate, noise=noise)
    step = np.ptp(slow.tau, axis=0) / levels
    assert find_frozen(replace(slow, tau=np.round(slow.tau / step) * step))[1] == {}


def test_rounded_efforts_freeze_as_well(arm: Any) -> None:
    """Where noise is some steps, as with decimals that are cut off; where it is one, nothing is said."""
    whole = arm.record(1, periods=3)
    noise = np.sqrt(arm.robot.noise.torque_variance)
    for steps, joints in ((4.0, [1]), (1.0, [])):
        rounded = replace(whole, tau=np.round(whole.tau / noise * steps) * noise / steps)
        assert list(find_frozen(frozen(rounded, [1], 20.0, 2.0, None))[1]) == joints


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.8])
def test_saturated_efforts_are_not_frozen(arm: Any, share: float) -> None:
    whole = arm.record(1, periods=3)
    bound = share * np.abs(whole.tau).max(axis=0)
    assert find_frozen(replace(whole, tau=np.clip(whole.tau, -bound, bound)))[1] == {}


@pytest.mark.parametrize("step", [0.0, 0.1, 1.0, 5.0])
def test_steady_speeds_rests_and_brakes_are_not_frozen(arm: Any, step: float) -> None:
    """Friction alone stands at one value at steady speed; at rest and behind a brake any effort may."""
    motion = moves(arm.robot, POINTS, pause=2.0)
    t = np.arange(0.0, motion.duration, 1.0 / 250.0)
    at = motion.reference(t)
    for noise in (0.0, 0.3):
        random = np.random.default_rng(0).normal(size=at.q.shape)
        tau = 20.0 * np.sign(np.round(at.dq, 6)) + 5.0 * np.round(at.dq, 2) + np.round(at.ddq, 1) + noise * random
        tau = np.where(np.abs(at.dq) < 1e-6, 0.0, tau)
        tau = np.round(tau / step) * step if step else tau
        assert find_frozen(Recording(arm.robot.joints, t, at.q, tau))[1] == {}


def test_coupled_efforts(arm: Any) -> None:
    """A frozen effort of one drive is missing in the torque of both joints that it moves."""
    coupling = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.4], [0.0, 0.0, 1.0]])
    robot = replace(arm.robot, effort=replace(arm.robot.effort, coupling=coupling))
    whole = arm.record(1, periods=3)
    drives = replace(whole, tau=np.linalg.solve(coupling, whole.tau.T).T)
    asked = Processing(periodic=False)
    plain, measured = process(drives, robot, asked), process(frozen(drives, [2], 20.0, 2.0, None), robot, asked)
    less = (plain.used & ~measured.used).sum(axis=0)
    assert less[0] == 0
    assert less[1:].min() > 100
