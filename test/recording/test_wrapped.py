"""Angles that are wrapped to one turn go on, where their joint can turn so far; what else leaps doesn't."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.repairs import repaired
from robot_ident.recording.summary import summarise
from robot_ident.robot.robot import Robot

TURN = 2.0 * np.pi


def wrapped(recording: Recording, around: float, joint: int = 0) -> Recording:
    """Return a recording in which a joint's angle stays within half a turn around an angle."""
    q = np.array(recording.q)
    q[:, joint] = (q[:, joint] - around + np.pi) % TURN - np.pi + around
    return replace(recording, q=q, source="w.npz")


def endless(robot: Robot, joint: int = 0) -> Robot:
    """Return a robot of which one joint has no position limits."""
    lower, upper = np.array(robot.limits.lower), np.array(robot.limits.upper)
    lower[joint], upper[joint] = -np.inf, np.inf
    return replace(robot, limits=replace(robot.limits, lower=lower, upper=upper))


@pytest.mark.parametrize("periodic", [None, False])
@pytest.mark.parametrize("rate", [150.0, 20.0])
def test_a_wrapped_angle_gives_the_same_measurement(arm: Any, rate: float, periodic: bool | None) -> None:
    """Where it crosses the seam fast, and where it turns round on it and flickers."""
    whole = arm.record(1, periods=4, rate=rate)
    for around in (np.pi + 0.2, np.pi + float(whole.q[:, 0].max()) - 1e-5):
        cut, asked = wrapped(whole, around), Processing(periodic=periodic)
        assert np.abs(np.diff(cut.q[:, 0])).max() > 6.0
        plain, measured = process(whole, endless(arm.robot), asked), process(cut, endless(arm.robot), asked)
        apart = measured.motion.q[:, 0] - plain.motion.q[:, 0]
        assert abs(np.median(apart) / TURN - round(np.median(apart) / TURN)) < 1e-6
        np.testing.assert_allclose(measured.motion.dq, plain.motion.dq, atol=1e-7)
        np.testing.assert_allclose(measured.torque, plain.torque, atol=1e-9)
        note = next(note for note in measured.notes if "wrapped angle" in note)
        assert note.startswith(f"joint_1 jumps by whole turns {np.sum(np.abs(np.diff(cut.q[:, 0])) > 6.0)} times")
        assert note in summarise(cut).notes


def test_the_seam_of_a_joint_with_limits(arm: Any) -> None:
    """It goes on within them, whichever side it began on, and is refused where it would turn too far."""
    whole = arm.record(1, periods=4)
    for around in (np.pi + 0.2, 0.2 - np.pi):
        measured = process(wrapped(whole, around), arm.robot)
        np.testing.assert_allclose(measured.motion.q, process(whole, arm.robot).motion.q, atol=1e-9)
    q = np.array(whole.q)
    q[:, 0] += 0.7 * (whole.t - whole.t[0])
    with pytest.raises(InputError, match=r"w.npz: joint_1 jumps by whole turns .* its range is -\S+ to \S+ rad"):
        process(wrapped(replace(whole, q=q), 0.0), arm.robot)


def test_estimates_are_true(arm: Any) -> None:
    truth = arm.structure.true_values()
    given = [wrapped(arm.record(seed, periods=8), 3.0) for seed in (1, 2)]
    found = estimate([process(one, arm.robot) for one in given], arm.structure)
    assert np.abs((found.values - truth) / found.std).max() < 3.0


@pytest.mark.parametrize("periods", [6, pytest.param(200, marks=pytest.mark.long)])
def test_a_joint_that_goes_on_turning_says_so(arm: Any, periods: int) -> None:
    """One turn each period is no period of its position: one pass, and the reason; never an average, though asked for,
    nor where the turns are so many that one more hardly counts.
    """
    whole = arm.record(1, periods=periods, lead=0.0, rate=30.0 if periods > 6 else 150.0)
    q = np.array(whole.q)
    q[:, 0] += TURN * (whole.t - whole.t[0]) / arm.series.period
    for recording in (replace(whole, q=q), wrapped(replace(whole, q=q), 0.0)):
        given = process(recording, endless(arm.robot), Processing(base_frequency=0.1))
        measured = process(recording, endless(arm.robot))
        assert measured.base_frequency is measured.cycles is given.base_frequency is None
        told = "s but for whole turns of joint_1 (+"
        assert any(told in note for note in measured.notes)
        assert any(told in note for note in summarise(recording).notes)
        np.testing.assert_allclose(
            np.median(measured.motion.dq[:, 0]), np.median(np.diff(q[:, 0])) / measured.dt, rtol=0.02
        )
        with pytest.raises(InputError, match="whole turns of joint_1"):
            process(recording, endless(arm.robot), Processing(periodic=True))
    assert not any("whole turns" in note for note in process(whole, endless(arm.robot)).notes)


def test_other_leaps_are_none_of_whole_turns(arm: Any) -> None:
    """Readings that were lost, angles in degrees, slides, a gap in which the joint turned, two publishers."""
    whole = arm.record(1, periods=4)
    lost = np.array(whole.q)
    lost[500] += 5.0
    for q in (lost, np.degrees(whole.q), np.degrees(wrapped(whole, 3.0).q), np.where(whole.q > 0.0, 3.0, -3.0)):
        some = replace(whole, q=q)
        assert repaired(some).q is some.q
    t = np.arange(0.0, 20.0, 0.01)
    q = np.column_stack([0.8 * t, np.sin(t)])
    there = (t < 5.0) | (t > 5.0 + TURN / 0.8)
    gone = Recording(("a", "b"), t[there], q[there], q[there])
    assert repaired(gone) is gone
