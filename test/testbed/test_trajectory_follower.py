"""A stand-in for a joint trajectory controller: splines through the points, smooth replacement, honest refusals."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.real_time import TrajectoryFollower


def wave(t: Array) -> Motion:
    """A motion of two joints that is at rest at t = 0 and t = 2."""
    w, size = np.pi, np.array([[1.0, -0.5]])
    t = t[:, None]
    return Motion(size * (1 - np.cos(w * t)), size * w * np.sin(w * t), size * w**2 * np.cos(w * t))


def test_follows_the_motion_between_its_points() -> None:
    follower = TrajectoryFollower(2)
    points = np.linspace(0.0, 2.0, 41)
    follower.take(0.0, points, wave(points))
    t = np.linspace(0.0, 2.0, 997)[:-1]
    motion = follower.at(t)
    np.testing.assert_allclose(motion.q, wave(t).q, atol=2e-8)
    np.testing.assert_allclose(motion.dq, wave(t).dq, atol=5e-6)
    np.testing.assert_allclose(np.gradient(motion.dq[:, 0], t)[1:-1], motion.ddq[1:-1, 0], atol=0.02)


def test_holds_before_and_after() -> None:
    follower = TrajectoryFollower(2)
    follower.reset([0.3, 0.4])
    still = follower.at(np.array([-1.0, 7.0]))
    np.testing.assert_array_equal(still.q, [[0.3, 0.4]] * 2)
    points = np.linspace(0.0, 2.0, 11)
    follower.take(0.0, points, wave(points))
    after = follower.at(np.array([2.0, 5.0]))
    np.testing.assert_allclose(after.q, np.repeat(wave(points[-1:]).q, 2, axis=0), atol=1e-12)
    assert not after.dq.any() and not after.ddq.any()


def test_a_window_with_points_of_the_past_goes_on_without_a_step() -> None:
    follower = TrajectoryFollower(2)
    points = np.linspace(0.0, 2.0, 101)
    follower.take(0.0, points, wave(points))
    before = follower.at(np.array([0.613]))
    later = points[(points > 0.5)]
    follower.take(0.613, later, wave(later))
    after = follower.at(np.array([0.613]))
    np.testing.assert_allclose(after.q, before.q, atol=1e-9)
    np.testing.assert_allclose(after.dq, before.dq, atol=1e-7)


def test_the_way_to_a_first_point_ahead_begins_where_it_is() -> None:
    follower = TrajectoryFollower(2)
    follower.reset([0.2, 0.0])
    follower.take(1.0, np.array([1.5, 2.0]), Motion(np.array([[0.3, 0.1]] * 2), np.zeros((2, 2)), np.zeros((2, 2))))
    motion = follower.at(np.array([1.0, 1.25, 1.5]))
    np.testing.assert_allclose(motion.q[:, 0], [0.2, 0.25, 0.3], atol=1e-12)
    np.testing.assert_allclose(motion.dq[[0, 2]], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("t", "dq", "why"),
    [
        ([0.0, 1.0], 0.1, "doesn't end at rest"),
        ([0.0, 0.0], 0.0, "don't follow one another"),
        ([-3.0, -2.0], 0.0, "ended 2.000 s ago"),
        ([0.0, np.nan], 0.0, "not finite"),
    ],
)
def test_refusals(t: list[float], dq: float, why: str) -> None:
    follower = TrajectoryFollower(2)
    follower.reset([0.2, 0.0])
    still = np.zeros((2, 2))
    with pytest.raises(InputError, match=why):
        follower.take(0.0, np.array(t), Motion(still, still + dq, still))
    np.testing.assert_array_equal(follower.at(np.array([0.5])).q, [[0.2, 0.0]])
