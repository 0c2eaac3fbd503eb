"""What the watch says of a robot that is silent, lost, mute or somewhere else."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.playback.supervisor import Bounds, Watch

JOINTS = ("a", "b")
MS = 1_000_000


def watch(timeout: float = 0.2, tracking: float = 0.1, effort: float = 50.0) -> Watch:
    return Watch(JOINTS, Bounds(timeout, np.full(2, tracking), np.full(2, effort)))


def feed(w: Watch, count: int, q: tuple[float, float] = (0.1, -0.2), speed: float = 0.0, begin: int = 0) -> float:
    now = 0.0
    for k in range(begin, begin + count):
        now = k * 0.01
        w.update(JOINTS, [q[0] + speed * now, q[1]], [1.0, 2.0], (k + 1) * 10 * MS, now)
    return now


def test_a_robot_at_rest_is_ready() -> None:
    w = watch()
    now = feed(w, 30)
    assert w.not_ready(now) == ""
    assert w.problem(now, np.array([[0.1, -0.2]])) == ""
    np.testing.assert_array_equal(w.state.q, [0.1, -0.2])  # type: ignore[union-attr]


def test_not_ready() -> None:
    w = watch()
    assert "no joint_states" in w.not_ready(0.0)
    now = feed(w, 3)
    assert "too short" in w.not_ready(now)
    moving = watch()
    now = feed(moving, 30, speed=0.5)
    assert "a moves at 0.500 rad/s" in moving.not_ready(now)
    now = feed(w, 30)
    assert "for 1.00 s" in w.not_ready(now + 1.0)


def test_time_that_stood_still_is_no_silence() -> None:
    w = watch()
    now = feed(w, 30)
    w.excuse(2.9, now + 3.0)
    assert w.problem(now + 3.0, np.array([[0.1, -0.2]])) == ""
    assert "for 0.40 s" in w.problem(now + 3.3, np.array([[0.1, -0.2]]))
    w.excuse(10.0, now + 3.5)
    assert "for 0.30 s" in w.problem(now + 3.8, np.array([[0.1, -0.2]])), "nothing is heard in the future"


def test_joints_are_matched_by_name_and_other_devices_passed_over() -> None:
    w = watch()
    w.update(("gripper",), [5.0], [0.0], 1, 0.0)
    assert w.state is None
    assert "lack a" in w.not_ready(0.0)
    w.update(("x", "b", "a"), [9.0, 2.0, 1.0], [], 2, 0.01)
    np.testing.assert_array_equal(w.state.q, [1.0, 2.0])  # type: ignore[union-attr]
    assert np.isnan(w.state.tau).all()  # type: ignore[union-attr]
    w.update(("gripper",), [5.0], [0.0], 3, 0.02)
    np.testing.assert_array_equal(w.state.q, [1.0, 2.0])  # type: ignore[union-attr]


@pytest.mark.parametrize("field", ["position", "effort"])
def test_nan_is_remembered_until_cleared(field: str) -> None:
    w = watch()
    now = feed(w, 30)
    position = [np.nan, 0.0] if field == "position" else [0.1, -0.2]
    effort = [0.0, np.nan] if field == "effort" else [0.0, 0.0]
    w.update(JOINTS, position, effort, 10_000 * MS, now)
    now = feed(w, 10, begin=2000)
    assert w.problem(now, np.array([[0.1, -0.2]])) == f"the {field} of {'a' if field == 'position' else 'b'} is nan"
    w.clear()
    assert w.problem(now, np.array([[0.1, -0.2]])) == ""


def test_stamps_that_stand_still_are_no_news() -> None:
    w = watch(timeout=0.2)
    now = feed(w, 30)
    for k in range(30):
        w.update(JOINTS, [0.1, -0.2], [1.0, 2.0], 30 * 10 * MS, now + 0.01 * k)
    assert "stamps stand still" in w.problem(now + 0.3, np.array([[0.1, -0.2]]))


def test_tracking_counts_from_the_range_of_the_last_commands() -> None:
    w = watch(tracking=0.05)
    now = feed(w, 30, q=(0.1, 0.0))
    assert w.problem(now, np.array([[0.0, 0.0], [0.1, 0.0], [0.3, 0.0]])) == ""
    assert "a is 0.1000 from where it was sent" in w.problem(now, np.array([[0.2, 0.0], [0.3, 0.0]]))
    assert w.worst_tracking[0] == pytest.approx(0.1)


def test_effort_beyond_its_bound() -> None:
    w = watch(effort=1.5)
    now = feed(w, 30)
    assert w.problem(now, np.array([[0.1, -0.2]])) == "the effort of b is 2.0 (bound 1.5)"
    w.bounds = Bounds(0.2, np.full(2, 0.1), np.full(2, np.inf))
    assert w.problem(now, np.array([[0.1, -0.2]])) == ""
