"""Stamps of a clock that runs wrong: seen in inertia that is off alike on all joints beside weight that is right."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.declaration import gain_of_all, judge_declaration


@pytest.fixture(scope="module")
def recording(arm: Any) -> Any:
    return arm.record(1, periods=3, lead=0.0)


def stretched(recording: Any, factor: float) -> Any:
    """Return what is recorded where the clock of the stamps runs so many times as fast as it should."""
    return replace(recording, t=recording.t[0] + (recording.t - recording.t[0]) * factor, dq=None)


@pytest.mark.parametrize(("factor", "way"), [(1.5, "fast"), (1 / 1.5, "slow")])
def test_the_clock_is_named_and_how_far_it_is_off(arm: Any, recording: Any, factor: float, way: str) -> None:
    found = judge_declaration(stretched(recording, factor), arm.robot)
    assert {one.verdict for one in found} == {"clock"}
    for one in found:
        told = re.search(rf"runs ([0-9.]+) times too {way}", one.hint)
        assert told and float(told[1]) == pytest.approx(1.5, rel=0.05)
    np.testing.assert_allclose([one.inertia for one in found], factor**2, rtol=0.1)


@pytest.mark.parametrize(("factor", "way"), [(1.1, "fast"), (0.9, "slow")])
def test_a_clock_a_tenth_off_shows_where_the_urdf_is_right(arm: Any, recording: Any, factor: float, way: str) -> None:
    found = judge_declaration(stretched(recording, factor), arm.robot)
    assert {one.verdict for one in found} == {"clock"} and way in found[0].hint
    motion = arm.series.motion(recording.t - recording.t[0])
    at_rest = replace(motion, dq=0.0 * motion.dq, ddq=0.0 * motion.ddq)
    inertial = arm.robot.rigid.inverse_dynamics(motion) - arm.robot.rigid.inverse_dynamics(at_rest)
    wrong = 0.2 * inertial * [1.0, 0.0, 0.0]
    other = judge_declaration(stretched(replace(recording, tau=recording.tau + wrong), factor), arm.robot)
    assert "clock" not in {one.verdict for one in other}, "a URDF that is wrong on one joint may be so on the others"


def test_a_gain_is_no_clock(arm: Any, recording: Any) -> None:
    """Weight is off as well."""
    found = judge_declaration(replace(recording, tau=recording.tau * 2.25), arm.robot)
    assert {one.verdict for one in found} == {"factor"}


def test_heavier_rotors_are_no_clock(arm: Any, recording: Any) -> None:
    """Rotors that the URDF lacks change the joints' inertia, each by its own."""
    rotors = arm.series.motion(recording.t - recording.t[0]).ddq * [30.0, 40.0, 10.0]
    found = judge_declaration(replace(recording, tau=recording.tau + rotors), arm.robot)
    assert "clock" not in {one.verdict for one in found}


def test_a_clock_a_little_off_stays_unsaid(arm: Any, recording: Any) -> None:
    assert {one.verdict for one in judge_declaration(stretched(recording, 1.03), arm.robot)} == {"consistent"}


@pytest.mark.parametrize("gain", [0.5, 0.75, 0.88, 1.15, 1.3, 2.0])
def test_a_gain_of_all_efforts_or_masses_wrong_alike(arm: Any, recording: Any, gain: float) -> None:
    """Which of both it is can't be told; it is no clock."""
    found = judge_declaration(replace(recording, tau=recording.tau * gain), arm.robot)
    told = re.search(r"are ([0-9.]+) times the URDF's", "".join(gain_of_all(found, arm.robot)))
    assert told and float(told[1]) == pytest.approx(gain, rel=0.05)
    assert "clock" not in {one.verdict for one in found}
    assert gain_of_all(judge_declaration(recording, arm.robot), arm.robot) == []
    one = judge_declaration(replace(recording, tau=recording.tau * [1.0, gain, 1.0]), arm.robot)
    assert gain_of_all(one, arm.robot) == []
