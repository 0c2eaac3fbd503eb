"""A speed override stretches time: said, and the stretched period used; another path is not mistaken for it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.recording import Processing, process
from robot_ident.recording.summary import mean_path, path_notes, speed_scale
from robot_ident.trajectories.fourier_series import FourierSeries


def slowed(arm: Any, share: float) -> Any:
    """Return the arm that runs the same path at a share of its speed."""
    series = arm.series
    return replace(arm, series=FourierSeries(0.1 * share, series.q0, share * series.a, share * series.b))


def scale_of(recording: Any, arm: Any) -> float | None:
    return speed_scale(recording.source, mean_path(recording), lambda t: arm.series.motion(t).q, 0.1)


@pytest.mark.parametrize("share", [0.87, 0.5])
def test_the_override_is_recognised(arm: Any, share: float) -> None:
    recording = slowed(arm, share).record(1, periods=3)
    found = scale_of(recording, arm)
    assert found == pytest.approx(share, rel=1e-4)


def test_full_speed_needs_no_word(arm: Any) -> None:
    assert scale_of(arm.record(1, periods=3), arm) == 1.0


def test_another_path_is_no_override(arm: Any) -> None:
    a, b = 0.25 * np.random.default_rng(7).normal(size=(2, 3, 5))
    other = replace(arm, series=FourierSeries(0.087, arm.series.q0, a, b))
    assert scale_of(other.record(1, periods=3), arm) is None


def test_another_path_of_the_same_period_is_refused(arm: Any) -> None:
    a, b = 0.25 * np.random.default_rng(7).normal(size=(2, 3, 5))
    other = replace(arm, series=FourierSeries(0.1, arm.series.q0, a, b))
    with pytest.raises(InputError, match="not the motion of the trajectory, though it has its period"):
        scale_of(other.record(1, periods=3), arm)


def test_without_the_path_it_is_refused_with_the_way_out(arm: Any) -> None:
    with pytest.raises(InputError, match=r"at 87 % of its speed.*--base-frequency 0\.087"):
        process(slowed(arm, 0.87).record(1, periods=3), arm.robot, Processing(base_frequency=0.1, periodic=True))


def test_a_joint_that_is_elsewhere_than_commanded_is_named(arm: Any) -> None:
    """Of another scale or zero: neither shows in the torque, whose parameters take it in."""

    def told(q: Any) -> tuple[str, ...]:
        recording = arm.record(1, periods=3)
        _, mean = mean_path(replace(recording, q=q(recording.q), dq=None))
        return path_notes(recording.names, mean, lambda t: arm.series.motion(t).q, 0.1, "e.yaml")

    assert told(lambda q: q) == () == told(lambda q: 1.01 * q + 0.002)
    (scale,) = told(lambda q: q * [1.0, 1.1, 1.0])
    assert "joint_2 moves 1.1 times as far as e.yaml commands" in scale
    (zero,) = told(lambda q: q + [0.0, 0.0, -0.1])
    assert "joint_3 is -0.1 away from where e.yaml commands it" in zero
