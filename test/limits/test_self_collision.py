"""Links stay apart: distances, their bounds and rates, the certificate, and what the search makes of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from robot_ident.design.constraints import Grid, Nearest, collision_rows
from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier, certify
from robot_ident.limits.feasibility import PoseLimits, allowed_poses
from robot_ident.limits.self_collision import (
    LinkPairs,
    capsule_about,
    keeps_apart,
    point_segment_distance,
    segment_distance,
)
from robot_ident.planning.approach import approach, check_pose
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation, Piece
from robot_ident.trajectories.fourier_series import FourierSeries


@pytest.fixture(scope="module")
def links(ur10: Robot) -> LinkPairs:
    return LinkPairs(ur10, ur10.geometry.shapes)


def all_distances(links: LinkPairs, q: Array) -> Array:
    return np.array([links.distances(pose, np.arange(links.count)) for pose in q])


def random_motion(robot: Robot, seed: int, size: float) -> Excitation:
    rng = np.random.default_rng(seed)
    pose = allowed_poses(robot, 20)[seed % 20]
    a, b = size * rng.normal(size=(2, robot.n, 5))
    return Excitation(robot.name, robot.joints, FourierSeries(0.1, pose, a, b), 150.0)


def test_capsules_hold_their_points_and_keep_their_distance() -> None:
    rng = np.random.default_rng(0)
    made = []
    for size in ((1.0, 0.1, 0.1), (0.3, 0.3, 0.3), (0.0, 0.0, 0.5)):
        points = rng.uniform(-1, 1, (50, 3)) * size + rng.normal(size=3)
        capsule = capsule_about(points, 0.02)
        assert np.all(point_segment_distance(points, capsule.ends) + 0.02 <= capsule.radius + 1e-12)
        made.append(capsule.ends)
    share = np.linspace(0.0, 1.0, 301)[:, None]
    for a, b in [*zip(made, made[1:], strict=False), (made[0], made[0] + [0.0, 1.0, 0.0]), (made[1], made[1][[0, 0]])]:
        first, second = a[0] + share * (a[1] - a[0]), b[0] + share * (b[1] - b[0])
        dense = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        assert segment_distance(a, b) == pytest.approx(dense, abs=1e-4)
        assert segment_distance(a, b) <= dense + 1e-12


def test_bounds_and_gradients_are_those_of_the_distances(ur10: Robot, links: LinkPairs) -> None:
    q, h = ur10.geometry.random_poses(40), 1e-4
    found = all_distances(links, q)
    assert np.all(links.bound(q) <= found + 1e-9)
    reaches = links.reaches(np.full(ur10.n, 3.0))
    rng, errors = np.random.default_rng(1), []
    for pose in q:
        way = rng.normal(size=ur10.n)
        ends = all_distances(links, np.array([pose - h * way, pose + h * way]))
        links.distances(pose, np.arange(links.count))
        slopes = links.gradients(np.arange(links.count))
        measured = (ends[1] - ends[0]) / (2 * h)
        apart = ends.min(axis=0) > 0.0
        assert np.all(np.abs(measured)[apart] <= (reaches @ np.abs(way))[apart] + 0.02), "the rate is bounded"
        assert np.all(np.abs(slopes[apart]) <= reaches[apart] + 1e-9)
        errors.append(np.abs(measured - slopes @ way))
    assert np.quantile(errors, 0.9) < 1e-3  # a few pairs are at an edge, where the nearest points jump


@pytest.mark.parametrize("seed", range(6))
def test_no_dense_search_finds_less_than_is_certified(seed: int, ur10: Robot, links: LinkPairs) -> None:
    motion = random_motion(ur10, seed, (0.1, 0.2, 0.4)[seed % 3])
    margins = certify(motion, ur10)
    (item,) = [item for item in margins.items if item.quantity == "self_collision"]
    t = np.linspace(0.0, motion.period, 1500)
    dense = min(links.closest(pose)[0] for pose in motion.series.motion(t).q) - item.limit
    assert item.margin <= dense + 1e-5
    assert item.margin >= dense - 2e-3, "not much more cautious than what a grid of 7 ms finds"
    at = motion.series.motion(np.array([item.time])).q[0]
    assert links.closest(at)[0] == pytest.approx(item.value, abs=1e-5)
    assert links.name(links.closest(at)[1]) == item.where
    piece = Piece(0.0, motion.period, motion.series.motion, motion.series.extremes())
    assert keeps_apart(links, piece) == item.kept


def test_rows_of_the_search_are_negative_where_links_touch(ur10: Robot, links: LinkPairs) -> None:
    nearest = Nearest(links, np.arange(links.count), ur10.geometry.clearance)
    q = ur10.geometry.random_poses(60)
    slack, slope = nearest(q)
    found = np.array([links.closest(pose)[0] for pose in q]) - ur10.geometry.clearance
    assert np.all(slack[found < 0.0] < 0.0)
    assert np.mean(slack[found > 0.0] > 0.0) > 0.8
    rng, h = np.random.default_rng(0), 1e-5
    way = rng.normal(size=q.shape)
    measured = (nearest(q + h * way)[0] - nearest(q - h * way)[0]) / (2 * h)
    assert np.median(np.abs(measured - np.einsum("ki,ki->k", slope, way))) < 1e-3


def test_rows_in_casadi_have_the_same_derivatives(ur10: Robot) -> None:
    class Asked:
        robot = ur10

    x = ca.MX.sym("q", ur10.n, 5)
    (rows,) = collision_rows(Asked(), Grid([x], 0.1, 0.0))  # type: ignore[arg-type]
    values, jacobian = (
        ca.Function("f", [x], [rows.expression]),
        ca.Function("j", [x], [ca.jacobian(rows.expression, x)]),
    )
    q, h = allowed_poses(ur10, 5).T, 1e-5
    way = np.random.default_rng(0).normal(size=q.shape)
    measured = (np.array(values(q + h * way)) - np.array(values(q - h * way))).ravel() / (2 * h)
    assert np.array(jacobian(q)) @ way.ravel(order="F") == pytest.approx(measured, abs=2e-3)
    assert np.all(rows.lower > 0.0)


def test_what_touches_is_named(ur10: Robot) -> None:
    folded = np.array([0.0, -1.0, 2.9, 0.0, 0.0, 0.0])
    with pytest.raises(
        InputError, match=r"the robot stands in self-collision: .*between links \(upper_arm_link and wrist_2_link"
    ):
        check_pose(ur10, folded, "the robot stands", PoseLimits(ur10))
    with pytest.raises(InputError, match="in self-collision"):
        approach(folded, allowed_poses(ur10, 1)[0], ur10)
    still = Excitation("ur10", ur10.joints, FourierSeries(0.1, folded, np.zeros((6, 1)), np.zeros((6, 1))), 150.0)
    worst = certify(still, ur10).violations[0]
    assert worst.quantity == "self_collision"
    assert "that breaks the clearance of 0.01 m" in str(worst)
    assert certify(still, ur10).to_json()["self_collision"]["links"] == worst.where


def test_an_approach_stays_apart(ur10: Robot, links: LinkPairs) -> None:
    start, goal = allowed_poses(ur10, 2)
    way = approach(start, goal, ur10)
    t = np.linspace(0.0, way.duration, 800)
    assert min(links.closest(pose)[0] for pose in way.reference(t).q) > ur10.geometry.clearance


def test_a_clearance_that_no_pose_keeps(ur10: Robot) -> None:
    robot = replace(ur10, geometry=replace(ur10.geometry, clearance=0.5))
    with pytest.raises(InputError, match=r"can't be met together.*clearance of 0\.5 m between links"):
        allowed_poses(robot, 5)


def test_a_missing_mesh_is_said_and_asked_for_is_an_error(ur10: Robot, tmp_path: Path) -> None:
    lost = replace(ur10.geometry, urdf=ur10.geometry.urdf.replace("forearm.stl", "lost.stl"))
    margins = Certifier(replace(ur10, geometry=lost)).margins(random_motion(ur10, 0, 0.1))
    assert any("self-collision" in text and "lost.stl" in text for text in margins.unknown)
    assert not [item for item in margins.items if item.quantity == "self_collision"]
    with pytest.raises(InputError, match=r"lost\.stl"):
        Certifier(replace(ur10, geometry=replace(lost, asked=True))).margins(random_motion(ur10, 0, 0.1))
