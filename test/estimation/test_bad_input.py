"""What can't be estimated is refused in one line that says why and what to do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.estimation.identify import identify
from robot_ident.estimation.least_squares import factor
from robot_ident.estimation.solve import solve
from robot_ident.recording import Processing, Recording, process


def refused(arm: Any, recording: Recording, words: str, **options: Any) -> None:
    with pytest.raises(InputError, match=words) as caught:
        identify([recording], arm.robot, **options)
    assert "\n" not in str(caught.value)


def test_sample_rate_that_changes(arm: Any) -> None:
    slow = arm.record(0, periods=2, lead=0.0)
    fast = arm.record(0, periods=2, lead=0.0, rate=300.0)
    t = np.concatenate([slow.t, slow.t[-1] + 1 / 300 + fast.t - fast.t[0]])
    both = Recording(slow.names, t, np.vstack([slow.q, fast.q]), np.vstack([slow.tau, fast.tau]), source="mixed")
    refused(arm, both, "mixed: the sample rate changes from 150 Hz to 300 Hz")


def test_joints_of_another_robot(arm: Any) -> None:
    r = arm.record(0, periods=2)
    refused(
        arm,
        Recording(("a1", "a2", "a3"), r.t, r.q, r.tau, source="other"),
        "'joint_1' is missing.*another robot.*--robot",
    )


@pytest.mark.parametrize(
    ("processing", "words"),
    [
        (Processing(low_pass=80.0), "low pass of 80 Hz; it must lie below half the sample rate, 75 Hz"),
        (Processing(anti_alias=(8, 40.0), low_pass=60.0), "lies above 42.8 Hz"),
        (Processing(anti_alias=(8, 40.0), low_pass=60.0, periodic=False), "lies above 42.8 Hz"),
        (Processing(anti_alias=(4, 75.0)), "cutoff of 75 Hz is not below half the sample rate"),
    ],
)
def test_filters_beyond_what_was_sampled(arm: Any, processing: Processing, words: str) -> None:
    refused(arm, arm.record(0, periods=2), words, processing=processing)


def test_iv_with_parameters_inside_columns(arm: Any) -> None:
    refused(
        arm,
        arm.record(0, periods=2),
        "iv estimates linear parameters alone",
        estimator="iv",
        effects=["stribeck@joint_1"],
        processing=Processing(periodic=False),
    )


def test_joints_that_stand_still_are_named_with_the_way_out(arm: Any) -> None:
    t = np.arange(3000) / 150.0
    q = np.column_stack([np.sin(0.2 * np.pi * t), np.full(3000, 0.3), np.full(3000, -0.2)])
    tau = np.random.default_rng(0).normal(size=q.shape)
    tau[:, 0] += 30.0 * np.cos(0.2 * np.pi * t)  # friction of the joint that moves
    held = Recording(arm.robot.joints, t, q, tau, source="held")
    refused(arm, held, "held: joint_2 has no usable sample .it stands still.*--joints joint_1$")


def test_speeds_that_no_joint_has(arm: Any) -> None:
    r = arm.record(0, periods=2)
    refused(arm, Recording(r.names, r.t / 100.0, r.q, r.tau, source="hasty"), "hasty: joint_1 moves at .* its limit is")


@pytest.mark.parametrize("factor", [1e-3, 57.3e-4])
def test_torque_in_another_unit_is_said(arm: Any, factor: float) -> None:
    r = arm.record(0, periods=2)
    model = identify([Recording(r.names, r.t, r.q, factor * r.tau)], arm.robot, as_declared=True)
    assert any("times what the URDF's masses need: another unit" in note for note in model.notes)
    assert not any("another unit" in note for note in identify([r], arm.robot).notes)


def test_torque_without_noise_is_no_measure_of_misfit(arm: Any) -> None:
    """A simulation without noise: rounding is not called noise, nor what exceeds it a misfit."""
    model = identify([arm.record(0, periods=4, lead=0.0, noise=0.0)], arm.robot)
    assert any("joint_1, joint_2, joint_3 repeats without noise" in note for note in model.notes)
    assert not any("exceeds the noise" in note or "not white" in note for note in model.notes)
    np.testing.assert_allclose(model.values, arm.structure.true_values(), atol=1e-3)
    noisy = identify([arm.record(0, periods=4, lead=0.0)], arm.robot)
    assert not any("without noise" in note for note in noisy.notes)


def test_an_option_that_does_nothing_is_said(arm: Any) -> None:
    model = identify([arm.record(0, periods=2)], arm.robot, processing=Processing(derivative_bandwidth=30.0))
    assert any("--derivative-bandwidth is for what does not repeat" in note for note in model.notes)


def test_noise_that_is_unknown_names_its_recording(arm: Any) -> None:
    periodic, once = arm.record(0, periods=3), arm.record(1, periods=1)
    model = identify([replace(periodic, source="a"), replace(once, source="b")], arm.robot)
    assert any(note.startswith("b: noise unknown without periods") for note in model.notes)


def test_periodic_and_other_recordings_make_one_estimate(arm: Any) -> None:
    """Two recordings of which one repeats: each is weighted by what it knows of its noise."""
    truth = arm.structure.true_values()
    distance = []
    for seed in range(6):
        periodic = process(arm.record(seed, periods=3, lead=0.0), arm.robot)
        once = process(arm.record(100 + seed, periods=2, lead=0.0), arm.robot, Processing(periodic=False))
        both, alone = solve([periodic, once], arm.structure, "wls"), solve([periodic], arm.structure, "wls")
        error = both.values - truth
        distance.append(error @ np.linalg.solve(both.covariance, error) / 21)
        assert np.all(np.diag(both.covariance) < 1.02 * np.diag(alone.covariance))
    assert 0.6 < np.mean(distance) < 1.6


def test_columns_that_the_motion_leaves_empty_are_named() -> None:
    phi = np.column_stack([np.arange(1.0, 6.0), np.zeros(5), np.ones(5)])
    with pytest.raises(InputError, match="run: the motion does not excite end_stop@joint_2; move the joints"):
        factor(phi, ["p1", "end_stop@joint_2", "torque_offset@joint_1"], "run")
