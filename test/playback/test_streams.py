"""Counting what is lost, counting periods, derivatives of the last samples."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from robot_ident.playback.commands import LocalMotion
from robot_ident.playback.plan import PeriodCounter
from robot_ident.playback.stamps import SequenceWatch, StampWatch, header_stamp
from robot_ident.signals.motion import Array

MS = 1_000_000


def test_stamps_tell_gaps_duplicates_and_late_ones() -> None:
    watch = StampWatch()
    stamps = [k * 10 * MS + 1 for k in range(200) if k not in (5, 6, 100, 150, 151, 152)]
    for stamp in stamps:
        watch.add(stamp)
    assert (watch.gaps, watch.missing) == (3, 6)
    assert watch.rate == pytest.approx(100.0)
    assert watch.longest == 40 * MS
    watch.add(stamps[-1])
    watch.add(stamps[-5])
    watch.add(0)
    assert (watch.received, watch.duplicates, watch.late) == (len(stamps) + 3, 1, 1)


def test_jitter_is_no_gap() -> None:
    watch = StampWatch()
    rng = np.random.default_rng(1)
    for k in range(2000):
        watch.add(int((10 * k + 1 + 4 * rng.random()) * MS))
    assert watch.gaps == 0


def test_sequence_numbers_of_two_senders() -> None:
    watch = SequenceWatch()
    for k in range(1, 50):
        watch.add(k)
        watch.add(1000 + 2 * k)  # every other one is lost
    assert watch.lost == 48


def test_header_stamp_of_either_byte_order() -> None:
    assert header_stamp(b"\x00\x01\x00\x00" + struct.pack("<iI", 12, 345)) == 12_000_000_345
    assert header_stamp(b"\x00\x00\x00\x00" + struct.pack(">iI", 12, 345)) == 12_000_000_345


def motion(t: float) -> Array:
    w = 2 * np.pi * 0.5
    return np.array([np.sin(w * t) + 0.3 * np.sin(5 * w * t), 0.5 * np.cos(2 * w * t)])


def due(wanted: int, end: float, total: float, glitch: float = -1.0) -> list[float]:
    counter = PeriodCounter(2.0)
    rng = np.random.default_rng(0)
    out = []
    for k in range(int(150 * total)):
        t = k / 150
        q = motion(min(t, end)) + 6e-5 * rng.normal(size=2)
        if glitch <= t < glitch + 1 / 150:
            q = q + 0.1
        if counter.add(t, q, wanted):
            out.append(t)
    return out


def test_periods_are_told_once() -> None:
    (told,) = due(3, 30.0, 20.0)
    assert 6.0 < told < 6.3
    (told,) = due(0, 9.0, 20.0)
    assert 9.0 < told < 9.3, "the end of the motion, where no number is wanted"
    (told,) = due(50, 9.0, 20.0)
    assert 9.0 < told < 9.3, "or where it ends before that number"
    (told,) = due(4, 30.0, 20.0, glitch=5.0)
    assert 8.0 < told < 8.3, "one bad sample ends nothing"


def test_a_robot_at_rest_has_no_periods() -> None:
    assert due(2, 0.0, 20.0) == []
    assert due(0, 1.0, 20.0) == []


def test_local_motion_against_the_truth() -> None:
    local = LocalMotion(0.08)
    w = 2 * np.pi * 0.5
    count = 0
    for k in range(600):
        t = k / 150
        state = local.add(round(t * 1e9), motion(t), np.array([t, 0.0]))
        if state is None:
            continue
        count += 1
        s = state.stamp_ns * 1e-9
        dq = [w * np.cos(w * s) + 1.5 * w * np.cos(5 * w * s), -w * np.sin(2 * w * s)]
        ddq = [-(w**2) * np.sin(w * s) - 7.5 * w**2 * np.sin(5 * w * s), -2 * w**2 * np.cos(2 * w * s)]
        np.testing.assert_allclose(state.motion.q[0], motion(s), atol=1e-5)
        np.testing.assert_allclose(state.motion.dq[0], dq, atol=3e-3)
        np.testing.assert_allclose(state.motion.ddq[0], ddq, atol=0.15)
        assert state.tau[0] == pytest.approx(s, abs=1e-8), "the torque is that of the same sample"
    assert count > 580


def test_local_motion_says_nothing_across_a_gap() -> None:
    local = LocalMotion(0.1)
    said = []
    for k in [*range(40), *range(60, 100)]:
        said.append(local.add(round(k / 150 * 1e9), motion(k / 150), np.zeros(2)) is not None)
    assert said[30] and said[-1]
    assert not any(said[40:50])


def test_every_sample_is_the_middle_once() -> None:
    local = LocalMotion(0.2)
    stamps = [1_700_000_000_000_000_000 + k * 20_000_000 // 3 for k in range(300)]
    states = [local.add(stamp, np.zeros(1), np.zeros(1)) for stamp in stamps]
    told = [state.stamp_ns for state in states if state is not None]
    assert told == stamps[15:-15]
