"""The validation motion and its file; gentle approaches; stops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier, certify
from robot_ident.planning.approach import approach
from robot_ident.planning.blends import Playback
from robot_ident.planning.stop import stop_from
from robot_ident.planning.validation_motion import moves, validation_motion
from robot_ident.robot import Robot
from robot_ident.robot.workspace import box
from robot_ident.signals.motion import Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import PointToPoint, load_motion


@pytest.fixture(scope="module")
def motion(kuka: Robot) -> PointToPoint:
    return validation_motion(kuka, seed=1)


def test_twenty_points_at_full_acceleration_with_a_full_stop_at_each(kuka: Robot, motion: PointToPoint) -> None:
    assert motion.points.shape == (20, 3)
    states = motion.reference(np.linspace(0.0, motion.duration, 200_001))
    share = np.abs(states.ddq) / kuka.limits.acceleration
    assert share.max() == pytest.approx(1.0, abs=1e-6)
    assert np.all(share < 1.0)
    stops = motion.reference(motion.stops)
    np.testing.assert_allclose(stops.q, motion.points, atol=1e-12)
    np.testing.assert_allclose(stops.dq, 0.0, atol=1e-12)


def test_every_limit_is_kept_and_dense_search_agrees(kuka: Robot, motion: PointToPoint) -> None:
    margins = certify(motion, kuka)
    assert margins.kept
    states = motion.reference(np.linspace(0.0, motion.duration, 100_001))
    assert np.all(states.q > kuka.limits.lower)
    assert np.all(states.q < kuka.limits.upper)
    assert np.all(np.abs(states.dq) < kuka.limits.velocity)
    for rule in kuka.workspace:
        found = float(rule.margin(kuka.rigid.frame_position(states.q[::10], rule.frame)).min())
        certified = next(item.margin for item in margins.items if item.where == rule.text)
        assert 0 < certified <= found


def test_position_and_velocity_have_no_step(motion: PointToPoint) -> None:
    t = np.arange(-0.1, motion.duration + 0.1, 1e-4)
    states = motion.reference(t)
    np.testing.assert_allclose(np.diff(states.q, axis=0) / 1e-4, (states.dq[1:] + states.dq[:-1]) / 2, atol=5e-4)
    assert np.abs(np.diff(states.dq, axis=0)).max() < 3.1e-4 * 2


def test_a_seed_gives_the_same_motion(kuka: Robot, motion: PointToPoint) -> None:
    assert np.array_equal(validation_motion(kuka, seed=1).points, motion.points)
    assert not np.array_equal(validation_motion(kuka, seed=2).points, motion.points)


def test_file_round_trip(tmp_path: Path, motion: PointToPoint, random_excitation: Callable[..., Excitation]) -> None:
    motion.write(tmp_path / "validation.yaml")
    again = load_motion(tmp_path / "validation.yaml")
    assert isinstance(again, PointToPoint)
    assert np.array_equal(again.points, motion.points)
    t = np.linspace(0.0, motion.duration, 500)
    assert np.array_equal(again.reference(t).q, motion.reference(t).q)
    random_excitation(0).write(tmp_path / "excitation.yaml")
    assert isinstance(load_motion(tmp_path / "excitation.yaml"), Excitation)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("law: fastest", "law: fast", "did you mean 'fastest'"),
        ("schema: robot_ident/point_to_point/1", "schema: robot_ident/other/1", "robot_ident/other/1"),
        ("velocity: [1.45, 1.45, 1.45]", "velocity: [1.45, 1.45]", "velocity has 2 numbers for 3 joints"),
        ("acceleration: [3.0, 3.0, 3.0]", "acceleration: [3.0, -3.0, 3.0]", "acceleration"),
        ("velocity: [1.45, 1.45, 1.45]", "velocity: [5.0e-324, 1.45, 1.45]", "it would take inf hours"),
        ("velocity: [1.45, 1.45, 1.45]", "velocity: [1.0e-170, 1.45, 1.45]", "it would take .*e\\+1.. hours"),
    ],
)
def test_a_file_that_is_wrong_is_refused(
    tmp_path: Path, motion: PointToPoint, old: str, new: str, message: str
) -> None:
    path = tmp_path / "motion.yaml"
    motion.write(path)
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_motion(path)


def test_a_step_at_the_edge_of_numbers_takes_no_time(kuka: Robot) -> None:
    points = np.array([[0.0, 0.0, 0.0], [5e-324, 0.2, 0.0]])
    assert moves(kuka, points).duration == pytest.approx(moves(kuka, points * [0.0, 1.0, 1.0]).duration)


def test_moves_with_pauses_and_paces(kuka: Robot) -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [1.0, 0.2, 0.0], [0.0, 0.5, 0.3]])
    full = moves(kuka, points, pause=0.5)
    slow = moves(kuka, points, pause=0.5, pace=np.array([0.5, 1.0, 1.0]))
    assert slow.duration > full.duration
    rest = full.reference(full.stops[1:2] - 0.25)
    np.testing.assert_allclose(rest.q[0], points[1], atol=1e-12)
    assert np.all(rest.dq == 0)


def test_an_approach_is_gentle_and_ends_at_rest_where_it_should(kuka: Robot) -> None:
    start, goal = np.array([-1.0, 0.9, 0.2]), np.array([1.2, -0.8, 0.5])
    way = approach(start, goal, kuka)
    states = way.reference(np.linspace(0.0, way.duration, 20_001))
    np.testing.assert_array_equal(states.q[0], start)
    np.testing.assert_allclose(states.q[-1], goal, atol=1e-12)
    assert np.all(np.abs(states.dq) <= 0.31 * kuka.limits.velocity)
    assert np.all(np.abs(states.ddq) <= 0.31 * kuka.limits.acceleration)
    assert np.abs(np.diff(states.ddq, axis=0)).max() < 0.02, "the acceleration jumps"
    assert certify(way, kuka).kept


def test_an_approach_goes_round_what_is_forbidden(kuka: Robot) -> None:
    pillar = box("flange", (0.2, -0.25, 0.0), (1.3, 0.25, 2.2), inside=False)
    robot = replace(kuka, workspace=(*kuka.workspace, pillar))
    start, goal = np.array([-0.9, 1.0, 0.3]), np.array([0.9, 1.0, 0.3])
    straight = moves(robot, np.array([start, goal]), law="smooth", share=0.3)
    assert not Certifier(robot).keeps(straight, torque=False)
    way = approach(start, goal, robot)
    assert len(way.points) > 2
    assert Certifier(robot).keeps(way, torque=False)
    np.testing.assert_array_equal(way.points[[0, -1]], [start, goal])


def test_an_approach_from_where_the_robot_stands_already(kuka: Robot) -> None:
    pose = np.array([0.1, 0.2, 0.3])
    way = approach(pose, pose, kuka)
    assert way.duration == 0.0
    np.testing.assert_array_equal(way.reference(np.array([0.0, 1.0])).q, [pose, pose])
    assert certify(way, kuka).kept


def test_a_start_outside_the_limits_is_named(kuka: Robot) -> None:
    inside = np.zeros(3)
    with pytest.raises(InputError, match=r"the robot stands outside the limits: joint_2 at 1.3 rad, its limit is 1.2"):
        approach(np.array([0.0, 1.3, 0.0]), inside, kuka)
    with pytest.raises(InputError, match="the goal is outside the limits: joint_1 at -2"):
        approach(inside, np.array([-2.0, 0.0, 0.0]), kuka)
    with pytest.raises(InputError, match="workspace.*broken by"):
        approach(np.array([0.0, 1.19, -1.19]) * [1, -1, -1], np.array([0.0, 1.19, 1.19]), kuka)
    with pytest.raises(InputError, match="3 finite positions"):
        approach(np.array([0.0, np.nan, 0.0]), inside, kuka)


def test_no_way_is_an_error(kuka: Robot) -> None:
    wall = box("flange", (-3.0, -0.2, -1.0), (3.0, 0.2, 4.0), inside=False)
    robot = replace(kuka, workspace=(wall,))
    with pytest.raises(InputError, match="no way was found"):
        approach(np.array([-0.9, 1.0, 0.3]), np.array([0.9, 1.0, 0.3]), robot)


@pytest.mark.parametrize("seed", range(4))
def test_a_stop_is_smooth_and_within_the_limits(
    seed: int, kuka: Robot, random_excitation: Callable[..., Excitation]
) -> None:
    playback = Playback(random_excitation(seed, share=0.9), kuka, 1)
    for t in np.linspace(8.0, 19.0, 6):
        state = playback.reference(np.array([t]))
        stop = stop_from(state, kuka)
        states = stop.reference(np.linspace(0.0, stop.duration + 0.1, 5001))
        np.testing.assert_allclose(states.q[0], state.q[0], atol=1e-12)
        np.testing.assert_allclose(states.dq[0], state.dq[0], atol=1e-12)
        assert np.all(np.abs(states.ddq) <= kuka.limits.acceleration * (1 + 1e-9))
        assert np.all(states.dq[-1] == 0)
        assert np.all(np.abs(np.diff(states.dq, axis=0)) < 0.01)
        if stop.certified:
            assert np.all((states.q > kuka.limits.lower) & (states.q < kuka.limits.upper))


def test_where_room_is_short_the_whole_acceleration_brakes(kuka: Robot) -> None:
    speed = 1.4
    room = speed**2 / (2 * 3.0) * 1.05  # hardly more than full braking needs
    state = Motion(np.array([[1.6 - room, 0.0, 0.0]]), np.array([[speed, 0.0, 0.0]]), np.zeros((1, 3)))
    stop = stop_from(state, kuka)
    assert stop.certified
    assert stop.reference(np.array([stop.duration])).q[0, 0] < 1.6
    beyond = stop_from(Motion(np.array([[1.55, 0.0, 0.0]]), state.dq, state.ddq), kuka)
    assert not beyond.certified
    assert np.all(beyond.reference(np.array([beyond.duration + 1e-6])).dq == 0.0)


def test_a_stop_from_rest_stays(kuka: Robot) -> None:
    pose = np.array([[0.3, 0.2, 0.1]])
    stop = stop_from(Motion(pose, 0 * pose, 0 * pose), kuka)
    np.testing.assert_allclose(stop.reference(np.array([0.0, 1.0])).q, np.repeat(pose, 2, axis=0))
    assert stop.certified
