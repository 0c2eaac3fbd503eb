"""Joints that stick as they reverse, under drives that know nothing of friction, and something missing besides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis, Unexplained
from robot_ident.diagnosis.unexplained import stiction_note
from robot_ident.recording import Processing, Recording, process
from robot_ident.regression.evidence import gather
from robot_ident.testbed.phenomena import plant_physics
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.simulation import Play

PERIODS = 12
NOISE = 0.75  # of the paper's variance: these periods tell as much as sixteen of its own
Hidden = Callable[[Recording], np.ndarray]


def late(joints: slice, delay: float) -> Hidden:
    """Return the efforts of some joints as they would be read so much later [s]: by the phase of their lines."""

    def hidden(recording: Recording) -> np.ndarray:
        tau, rate = recording.tau.copy(), 1.0 / np.median(np.diff(recording.t))
        turns = np.exp(-2j * np.pi * np.fft.rfftfreq(len(tau), 1.0 / rate) * delay)
        tau[:, joints] = np.fft.irfft(np.fft.rfft(tau[:, joints], axis=0) * turns[:, None], len(tau), axis=0)
        return tau

    return hidden


@pytest.fixture(scope="module")
def found(bench: Any) -> Callable[[Hidden], Diagnosis]:
    servo = Servo.make(bench.robot, "pd")
    plays = [Play.of(bench.robot, plant_physics(bench.robot, ()), motion, servo=servo) for motion in bench.motions[:3]]
    recordings = [play.record(PERIODS, noise=NOISE, seed=70 + k) for k, play in enumerate(plays)]

    def judged(hidden: Hidden) -> Diagnosis:
        measured = [process(replace(one, tau=hidden(one)), bench.robot) for one in recordings]
        return diagnose(measured, bench.structure)

    return judged


def test_stiction_alone_gets_no_name(found: Callable[[Hidden], Diagnosis]) -> None:
    assert not found(lambda recording: recording.tau).missing


@pytest.mark.parametrize("delay", [pytest.param(-0.012, marks=pytest.mark.long), 0.012])
def test_a_delay_of_a_joint_is_named(found: Callable[[Hidden], Diagnosis], delay: float) -> None:
    (finding,) = found(late(slice(0, 1), delay)).missing
    assert finding.label == "time_delay@joint_1"
    (size,) = [p.value for p in finding.parameters if p.name == "time_delay.delay@joint_1"]
    assert size == pytest.approx(1e3 * delay, rel=0.4)


@pytest.mark.long
def test_a_delay_of_all_joints_is_not_named_twice(found: Callable[[Hidden], Diagnosis]) -> None:
    assert [finding.label for finding in found(late(slice(None), 0.007)).missing] == ["time_delay"]


def test_a_remainder_at_reversals_says_how_to_leave_them_out(bench: Any) -> None:
    every, fast = (process(bench.record((), 0), bench.robot, Processing(minimum_speed=v)) for v in (None, (0.02,) * 3))
    at_reversals = Unexplained("joint_1", {"position": 0.1, "time_since_reversal": 0.2}, "")
    (note,) = stiction_note(at_reversals, gather([every], bench.structure))
    assert "joint_1" in note and "--minimum-speed 0.02" in note
    assert not stiction_note(at_reversals, gather([fast], bench.structure))
    elsewhere = replace(at_reversals, depends_on={"position": 0.3, "time_since_reversal": 0.2})
    assert not stiction_note(elsewhere, gather([every], bench.structure))
    slow = replace(elsewhere, around_reversals=True)
    assert stiction_note(slow, gather([every], bench.structure)) == [note]
