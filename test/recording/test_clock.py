"""The clock: late stamps are ignored, uneven sampling is believed, gaps are counted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.recording import Recording, process
from robot_ident.recording.clock import _grid, read_clock
from robot_ident.signals.motion import Array


def test_even_stamps_need_no_word(arm: Any) -> None:
    clock = read_clock(arm.record(periods=2))
    assert clock.notes == ()
    assert clock.dt == pytest.approx(1 / 150, rel=1e-9)


@pytest.mark.parametrize("late", [2e-4, 1e-3, 3e-3])
def test_late_stamps_are_recognised_and_the_clock_regularised(arm: Any, late: float) -> None:
    clock = read_clock(arm.record(3, periods=3, late=late))
    assert "the sampling does not" in clock.notes[0]
    assert clock.index is not None
    assert np.ptp(np.diff(clock.t)) < 1e-9
    assert clock.dt == pytest.approx(1 / 150, rel=1e-5)


@pytest.mark.parametrize("jitter", [2e-4, 1e-3])
def test_uneven_sampling_is_recognised_and_its_stamps_kept(arm: Any, jitter: float) -> None:
    recording = arm.record(4, periods=3, jitter=jitter)
    clock = read_clock(recording)
    assert "stamps used" in clock.notes[-1]
    np.testing.assert_array_equal(clock.t, recording.t)


def test_dropped_samples_are_counted_and_keep_their_place(arm: Any) -> None:
    whole, holed = arm.record(5, periods=2), arm.record(5, periods=2, dropped=0.05)
    clock = read_clock(holed)
    assert clock.index is not None
    assert clock.missing == int(clock.index[-1]) + 1 - holed.samples
    exact = np.rint((holed.t - holed.t[0]) * 150).astype(int)
    np.testing.assert_array_equal(clock.index, exact)
    assert whole.samples > holed.samples


@pytest.mark.parametrize("seed", range(12))
def test_drops_and_jitter_together_slip_no_sample(arm: Any, seed: int) -> None:
    recording = arm.record(seed, periods=8, dropped=0.02, jitter=1e-3)
    clock = read_clock(recording)
    assert clock.dt == pytest.approx(1 / 150, rel=1e-5)


def test_clock_drift_of_100_ppm_does_not_slip_a_sample() -> None:
    t = np.arange(200_000) / 500.0 * (1 + 1e-4)
    q = np.sin(t)[:, None]
    clock = read_clock(Recording(("j",), t, q, q))
    np.testing.assert_array_equal(clock.index, np.arange(200_000))


def test_too_few_samples_are_refused() -> None:
    t = np.arange(5) / 10.0
    with pytest.raises(InputError, match="5 samples"):
        read_clock(Recording(("j",), t, t[:, None], t[:, None]))


def test_late_stamps_cost_nothing_in_position(arm: Any) -> None:
    """2 ms of random lateness at 125 Hz: taken at face value the positions would stray by the speed times 2 ms."""
    late, prompt = (arm.record(6, periods=4, rate=125.0, late=value) for value in (2e-3, 0.0))
    stamps = read_clock(late).stamps
    assert stamps.kind == "late"
    assert stamps.even is not None
    assert stamps.stamped is not None
    assert stamps.stamped > 10.0 * stamps.even

    begin = prompt.t[-1] - 1000.0 - (4 * 1250 - 1) / 125.0  # the periods end with the recording
    exact = arm.series.motion(begin + np.arange(1250) / 125.0).q
    faces = arm.series.motion(begin + np.arange(1250) / 125.0 + late.t[-1250:] - prompt.t[-1250:]).q

    def stray(q: Array) -> float:
        gap = q - exact - (q - exact).mean(axis=0)
        return float(np.sqrt(np.mean(gap**2)))

    told, best = (process(recording, arm.robot).motion.q for recording in (late, prompt))
    assert stray(faces) > 28.0 * stray(best)
    assert stray(told) < 1.5 * stray(best)


def test_the_choice_is_the_smaller_residual(arm: Any) -> None:
    for recording in (arm.record(1, periods=3, late=1e-3), arm.record(1, periods=3, jitter=1e-3)):
        stamps = read_clock(recording).stamps
        assert stamps.even is not None
        assert stamps.stamped is not None
        assert (stamps.kind == "late") == (stamps.even < stamps.stamped)
        assert stamps.jitter == pytest.approx(1e-3, rel=0.5)


@pytest.mark.parametrize("seed", [0, 2, 8, 10])
def test_late_stamps_of_a_long_recording_stretch_no_time(seed: int) -> None:
    """Of 24 000 stamps some neighbours are all late: that is no gap, and the rate is that of all of them."""
    random, count, dt = np.random.default_rng(seed), 24_000, 1 / 150
    late = random.gamma(2.0, random.uniform(1.3e-3, 2e-3) / np.sqrt(2.0), count)
    stamps = np.maximum.accumulate(np.arange(count) * dt + late) + 1e-12 * np.arange(count)
    index, _, found = _grid(stamps - stamps[0])
    assert found == pytest.approx(dt, rel=1e-6)
    assert index[-1] - (count - 1) <= 1
