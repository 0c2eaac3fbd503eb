"""Tours of approved moves: closed, certified, only what is approved, and telling more than a random order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.design.target import Target
from robot_ident.design.tours import Waypoints, plan_tour
from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify

LIST = """\
schema: robot_ident/waypoints/1
joints: [joint_1, joint_2, joint_3]
poses:
  home: [0, 0.2, -0.3]
  pick: [1.0, 0.6, -0.8]
  place: [-0.9, -0.4, 0.7]
  high: [0.0, 0.9, 0.5]
"""


@pytest.fixture
def listed(tmp_path: Path, arm: Any) -> Any:
    def make(more: str = "", text: str = LIST) -> Waypoints:
        (tmp_path / "list.yaml").write_text(text + more, encoding="utf-8")
        return Waypoints.read(tmp_path / "list.yaml", arm.robot)

    return make


def test_the_tour_is_closed_certified_and_tells_every_parameter(arm: Any, listed: Any) -> None:
    waypoints = listed()
    tour = plan_tour(Target.of_robot(arm.robot), waypoints, length=8, repeats=5, seed=1)
    assert tour.names[0] == tour.names[-1]
    assert len(tour.paces) <= 8
    assert all(pair in waypoints.moves for pair in zip(tour.names[:-1], tour.names[1:], strict=True))
    assert tour.margins.kept
    assert certify(tour.motion, arm.robot).kept
    assert np.isfinite(tour.evaluation.log10_det_covariance)
    assert len(tour.motion.points) == 5 * len(tour.paces) + 1
    assert tour.motion.duration == pytest.approx(5 * tour.cycle.duration, rel=1e-9)


def test_only_approved_moves_are_taken(arm: Any, listed: Any) -> None:
    waypoints = listed("moves: [[home, pick], [pick, place], [place, home], [home, high], [high, home]]\n")
    tour = plan_tour(Target.of_robot(arm.robot), waypoints, length=6, seed=0)
    assert {*zip(tour.names[:-1], tour.names[1:], strict=True)} <= set(waypoints.moves)


def test_searching_tells_more_a_second_than_the_order_of_the_list(arm: Any, listed: Any) -> None:
    waypoints = listed()
    target = Target.of_robot(arm.robot)
    best = plan_tour(target, waypoints, length=8, seed=1)
    plain = plan_tour(target, listed("moves: [[home, pick], [pick, place], [place, high], [high, home]]\n"), length=4)
    p, rate = len(target.structure.names), lambda tour: np.log10(tour.cycle.duration)
    assert best.evaluation.log10_det_covariance + p * rate(best) < (
        plain.evaluation.log10_det_covariance + p * rate(plain)
    )


def test_moves_that_break_a_limit_are_left_out_and_named(arm: Any, listed: Any) -> None:
    # straight down in front of the arm: the flange would pass below the floor of its workspace
    text = LIST.replace("  high: [0.0, 0.9, 0.5]\n", "  high: [0.0, 0.9, 0.5]\n  below: [0.0, 1.5, 0.0]\n")
    tour = plan_tour(Target.of_robot(arm.robot), listed(text=text), length=6, seed=0)
    assert tour.refused
    assert all("below" in move for move in tour.refused)
    assert "below" not in tour.names


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("joint_3]", "joint_4]"), "joints = joint_1, joint_2, joint_4"),
        (("home: [0, 0.2, -0.3]", "home: [0, 0.2]"), "poses.home has 2 numbers for 3 joints"),
        (("poses:", "moves: [[home, pic]]\nposes:"), "moves.0: 'pic'; did you mean 'pick'"),
        (("poses:", "pause: 1e9\nposes:"), "pause = '1e9'"),
        (("poses:", "law: smoth\nposes:"), "law = 'smoth'; did you mean 'smooth'"),
    ],
)
def test_lists_that_can_not_be_used_are_one_line(listed: Any, change: tuple[str, str], words: str) -> None:
    with pytest.raises(InputError) as raised:
        listed(text=LIST.replace(*change))
    assert words in str(raised.value)


def test_poses_in_degrees_are_named(arm: Any, listed: Any) -> None:
    waypoints = replace(listed(), poses={"home": np.zeros(3), "pick": np.array([45.0, 10.0, 0.0])})
    waypoints = replace(waypoints, moves=(("home", "pick"), ("pick", "home")))
    with pytest.raises(InputError, match="poses.pick: joint_1 = 45 is not within"):
        plan_tour(Target.of_robot(arm.robot), waypoints)


def test_what_the_moves_leave_open_is_named(arm: Any, listed: Any) -> None:
    text = LIST.replace("[1.0, ", "[0, ").replace("[-0.9, ", "[0, ")
    target = Target.of_robot(arm.robot)
    tour = plan_tour(target, listed(text=text), length=6)
    assert tour.resting == ("joint_1",)
    assert {"p1", "viscous@joint_1", "coulomb@joint_1"} <= set(tour.unidentifiable) < set(target.structure.names)
    assert "p9" not in tour.unidentifiable
    assert plan_tour(target, listed(), length=8).unidentifiable == ()


@pytest.mark.parametrize("step", [0.0, 1e-9, 3e-5])
def test_poses_that_are_alike_are_no_moves(arm: Any, listed: Any, step: float) -> None:
    waypoints = replace(listed(), poses={"home": np.zeros(3), "pick": np.full(3, step)})
    waypoints = replace(waypoints, moves=(("home", "pick"), ("pick", "home")))
    with pytest.raises(InputError, match="the poses that they join are alike"):
        plan_tour(Target.of_robot(arm.robot), waypoints)


def test_moves_without_a_way_back_are_refused(arm: Any, listed: Any) -> None:
    with pytest.raises(InputError, match="no closed tour"):
        plan_tour(Target.of_robot(arm.robot), listed("moves: [[home, pick], [pick, place]]\n"))
