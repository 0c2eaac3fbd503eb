"""Positions that are read more slowly than they are published are as old as their efforts; what only looks like them
stays as it is.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import estimate
from robot_ident.planning.validation_motion import moves
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.repairs import repaired
from robot_ident.recording.summary import summarise

POINTS = np.array([[0, 0, 0], [1, 0.5, -0.5], [0.3, -0.4, 0.8], [-1, 0.2, 0.1], [0, 0, 0]] * 4)


def held(recording: Recording, every: float, first: float = 0.0) -> Recording:
    """Return a recording whose positions are read once in so many samples, from one of them on."""
    row = np.arange(recording.samples)
    read = np.floor((row - first) / every + 1e-9) * every + first  # of the reading that a sample repeats
    return replace(recording, q=recording.q[np.clip(np.ceil(read - 1e-9).astype(int), 0, None)], source="held.npz")


@pytest.mark.parametrize("every", [2, 5])
@pytest.mark.parametrize("periodic", [None, False])
def test_estimates_are_true_again(arm: Any, every: int, periodic: bool | None) -> None:
    truth = arm.structure.true_values()
    given = [held(arm.record(seed, periods=12), every, first=1) for seed in (1, 2)]
    asked = Processing(periodic=periodic)
    measured = [process(recording, arm.robot, asked) for recording in given]
    told = f"once in {every} samples ({150 / every:.3g} Hz of 150 Hz)"
    assert all(any(told in note for note in one.notes) for one in measured)
    assert told in " ".join(summarise(given[0]).notes)
    found = estimate(measured, arm.structure)
    assert np.abs((found.values - truth) / found.std).max() < 3.0


def test_a_held_position_is_late_beside_its_effort(arm: Any) -> None:
    """Were its rows kept, estimates would be far from the truth: the test above asks for something."""
    recording = held(arm.record(1, periods=12), 5)
    noisy = replace(recording, q=recording.q + 1e-6 * np.random.default_rng(0).normal(size=recording.q.shape))
    found = estimate([process(noisy, arm.robot)], arm.structure)
    assert np.abs((found.values - arm.structure.true_values()) / found.std).max() > 6.0


@pytest.mark.parametrize("every", [1.6, 3.75, 4.0, 20.0])
def test_rows_that_stay(arm: Any, every: float) -> None:
    """Those at which a position is read, whatever the rates, with the effort of that sample, once and no more."""
    whole = arm.record(1, periods=12)
    kept = repaired(held(whole, every))
    assert abs(whole.samples / kept.samples / every - 1.0) < 0.02
    rows = np.searchsorted(whole.t, kept.t)
    np.testing.assert_array_equal(kept.tau, whole.tau[rows])
    assert np.mean(np.all(kept.q == whole.q[rows], axis=1)) > 0.97
    assert repaired(kept) is kept


def test_rests_between_moves_keep_their_rate(arm: Any) -> None:
    motion = moves(arm.robot, POINTS, pause=1.5)
    t = np.arange(0.0, motion.duration, 1.0 / 250.0)
    recording = Recording(arm.robot.joints, t, motion.reference(t).q, np.cos(t[:, None] * [1.0, 2.0, 3.0]))
    kept = repaired(held(recording, 5))
    np.testing.assert_allclose(np.diff(kept.t), 0.02, atol=1e-6)


def test_no_regular_number_of_samples(arm: Any) -> None:
    recording = arm.record(1, periods=4)
    reads = np.sort(np.random.default_rng(0).choice(recording.samples, recording.samples // 6, replace=False))
    latest = reads[np.maximum(np.searchsorted(reads, np.arange(recording.samples), side="right") - 1, 0)]
    spoilt = replace(recording, q=recording.q[latest], source="held.npz")
    with pytest.raises(InputError, match=r"held.npz: positions change once in .* samples .* now after 1, now after"):
        process(spoilt, arm.robot)


@pytest.mark.parametrize("rate", [100.0, 500.0, 1000.0])
@pytest.mark.parametrize("step", [0.0, 1e-5, 1e-3, 1e-2])
def test_ordinary_positions_stay(arm: Any, step: float, rate: float) -> None:
    """Point-to-point with rests, on encoders fine and coarse, quiet and flickering, of all joints and of one alone."""
    motion = moves(arm.robot, POINTS, pause=1.0)
    t = np.arange(0.0, motion.duration, 1.0 / rate)
    random = np.random.default_rng(1)
    for noise in (0.0, 1e-4, step):
        q = motion.reference(t).q + noise * random.normal(size=(len(t), 3))
        q = np.round(q / step) * step if step else q
        for joints in (slice(None), slice(0, 1)):
            recording = Recording(arm.robot.joints[joints], t, q[:, joints], q[:, joints])
            assert repaired(recording) is recording


@pytest.mark.parametrize("share", [0.2, 0.25, 1 / 3, 0.5])
def test_steady_speeds_on_an_encoder_stay(share: float) -> None:
    """At so many counts a sample a position changes once in so many samples, by one count."""
    step = 2.0 * np.pi / 2**12
    q = np.round(np.cumsum(np.repeat(np.array([1, -1, 1, 2, -2]) * share * step, 1400)) / step)[:, None] * step
    recording = Recording(("shaft",), np.arange(len(q)) / 250.0, q, np.sin(q))
    assert repaired(recording) is recording


def test_a_joint_that_others_do_not_wait_for(arm: Any) -> None:
    """What one joint repeats while others move is not held with them."""
    recording = arm.record(1, periods=4)
    q = np.array(recording.q)
    q[:, 0] = held(recording, 5).q[:, 0]
    some = replace(recording, q=q)
    assert repaired(some) is some


def test_lost_messages(arm: Any) -> None:
    """Neither are samples that were lost taken for held ones, nor do they hide those."""
    recording = arm.record(1, periods=4, dropped=0.4)
    assert repaired(recording) is recording
    there = np.random.default_rng(3).random(recording.samples) > 0.01
    kept = repaired(held(arm.record(1, periods=4), 5)[np.resize(there, arm.record(1, periods=4).samples)])
    assert abs(np.median(np.diff(kept.t)) * 30.0 - 1.0) < 1e-3
