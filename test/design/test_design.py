"""The design: better than the paper from a cold start, always certified, for any robot; clear words where it fails."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.design.criteria import evaluate
from robot_ident.design.design import DesignResult, Progress, design
from robot_ident.errors import InputError
from robot_ident.limits.certifier import certify
from robot_ident.limits.feasibility import allowed_poses
from robot_ident.model.structure import Structure
from robot_ident.planning.blends import Playback
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.workspace import box, half_space
from robot_ident.trajectories.excitation import Excitation

PAPER = np.log10(2.36e-49)


@pytest.fixture(scope="module")
def designed(kuka: Robot) -> DesignResult:
    return design(kuka, starts=1, workers=1, seed=0)


def test_one_cold_start_beats_the_paper(kuka: Robot, designed: DesignResult) -> None:
    assert designed.log10_det_covariance < PAPER - 0.2
    assert designed.log10_det_covariance == evaluate(Structure.build(kuka), designed.excitation).log10_det_covariance
    assert len(designed.sigma) == len(designed.parameters) == 21


def test_the_result_is_certified_as_it_stands_in_its_file(tmp_path: Path, kuka: Robot, designed: DesignResult) -> None:
    designed.excitation.write(tmp_path / "excitation.yaml")
    again = Excitation.read(tmp_path / "excitation.yaml")
    assert certify(again, kuka).kept
    assert again.criterion == "d-optimal"
    assert again.achieved["log10_det_covariance"] == designed.log10_det_covariance
    assert again.achieved["parameters"] == 21
    assert again.reproduce["seed"] == 0
    assert again.limits["velocity"] == [1.45, 1.45, 1.45]


def test_the_result_can_be_played(kuka: Robot, designed: DesignResult) -> None:
    assert certify(Playback(designed.excitation, kuka, 1), kuka).kept


def test_the_history_falls_and_begins_with_something_feasible(designed: DesignResult) -> None:
    seconds, costs = zip(*designed.history, strict=True)
    assert list(seconds) == sorted(seconds)
    assert list(costs) == sorted(costs, reverse=True)
    assert costs[0] > costs[-1] + 3


@pytest.mark.long
def test_a_seed_gives_the_same_trajectory_whatever_the_workers(gantry: Robot) -> None:
    one, two = (design(gantry, base_frequency=0.25, harmonics=3, starts=2, workers=n, seed=4) for n in (1, 2))
    assert np.array_equal(one.excitation.series.a, two.excitation.series.a)
    other = design(gantry, base_frequency=0.25, harmonics=3, starts=2, workers=1, seed=5)
    assert not np.array_equal(one.excitation.series.a, other.excitation.series.a)


def test_slide_and_arm(gantry: Robot) -> None:
    found = design(gantry, base_frequency=0.25, harmonics=3, starts=3, workers=1)
    assert found.margins.kept
    assert {item.unit for item in found.margins.items if item.where == "slide"} == {"m", "m/s", "m/s^2", "N"}
    assert found.history[0][1] > found.log10_det_covariance + 1


@pytest.mark.long
def test_condition_number_with_a_floor_on_the_determinant(kuka: Robot) -> None:
    found = design(kuka, criterion="condition", starts=1, workers=1, determinant_floor=-43.0)
    assert found.condition_number < 4.15
    assert found.log10_det_covariance <= -43.0
    assert found.margins.kept


def test_further_effects_are_designed_for(kuka: Robot) -> None:
    found = design(kuka, effects=["torque_offset@joint_2"], starts=1, workers=1, harmonics=3)
    assert found.parameters[-1] == "torque_offset@joint_2"
    assert np.all(np.isfinite(found.sigma))


def test_a_time_limit_ends_it_with_the_best_so_far(kuka: Robot) -> None:
    seen: list[Progress] = []
    found = design(kuka, deadline=time.monotonic() + 3.0, workers=1, progress=seen.append)
    assert found.margins.kept
    assert seen[0].seconds <= seen[-1].seconds
    assert seen[-1].log10_det_covariance == pytest.approx(found.log10_det_covariance, abs=1e-6)


def test_a_time_limit_that_ends_too_soon_is_said_and_not_laid_on_the_limits(kuka: Robot) -> None:
    with pytest.raises(InputError, match=r"the time limit ended the search.*--time-limit"):
        design(kuka, criterion="condition", time_limit=0.01, workers=1)


def test_what_was_asked_for_is_written_whatever_the_start_of_the_process_took(kuka: Robot) -> None:
    found = design(kuka, time_limit=6.0, deadline=time.monotonic() + 2.0, workers=1)
    assert found.excitation.reproduce["time_limit"] == 6.0


def test_who_cancels_keeps_the_best(kuka: Robot) -> None:
    found = design(kuka, workers=1, cancel=lambda: True)
    assert found.interrupted
    assert found.margins.kept


def test_ctrl_c_keeps_the_best(kuka: Robot) -> None:
    def interrupt(state: Progress) -> None:
        if state.done:
            raise KeyboardInterrupt

    found = design(kuka, starts=3, workers=1, progress=interrupt)
    assert found.interrupted
    assert found.margins.kept


@pytest.mark.long
def test_a_six_axis_arm_from_its_urdf(tmp_path: Path, robots_folder: Path) -> None:
    urdf = robots_folder / "ur_description/urdf/ur10_robot.urdf"
    robot = load_robot(write_ur10(tmp_path, urdf))
    seen: list[Progress] = []
    plan: dict[str, Any] = {"harmonics": 3, "base_frequency": 0.25, "sample_rate": 50.0, "starts": 1, "workers": 1}
    # one search is enough: what refines it later is the same for every robot
    found = design(robot, **plan, progress=seen.append, cancel=lambda: bool(seen and seen[-1].done))
    assert seen[-1].done == 1
    assert found.margins.kept
    assert certify(found.excitation, robot).kept
    assert found.log10_det_covariance < found.history[0][1] - 5, "less than five decades better than random"


def write_ur10(folder: Path, urdf: Path) -> Path:
    joints = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    lines = [
        f"  {joint}_joint: {{position: [-3, 3], acceleration: 5, torque_variance: {variance}}}"
        for joint, variance in zip(joints, (25, 25, 9, 1, 1, 1), strict=True)
    ]
    path = folder / "ur10.yaml"
    text = f"schema: robot_ident/robot/1\nname: ur10\nurdf: {urdf}\nend_effector: ee_link\njoints:\n" + "\n".join(lines)
    path.write_text(text + "\nworkspace:\n  - {kind: half_space, normal: [0, 0, 1], offset: 0.1}\n", encoding="utf-8")
    return path


def test_missing_limits_are_named_not_invented(kuka: Robot) -> None:
    limits = replace(kuka.limits, acceleration=np.array([3.0, np.inf, np.inf]))
    with pytest.raises(InputError, match="no acceleration limit for joint_2, joint_3: give acceleration: under joints"):
        design(replace(kuka, limits=limits))
    limits = replace(kuka.limits, velocity=np.full(3, np.inf), upper=np.array([np.inf, 1.2, 1.2]))
    with pytest.raises(InputError, match="no position limit for joint_1; no velocity limit"):
        design(replace(kuka, limits=limits))


def test_limits_that_cannot_be_met_together_are_named(kuka: Robot) -> None:
    high = half_space("flange", (0.0, 0.0, 1.0), 5.0)
    with pytest.raises(InputError, match="can't be met together: the position limits and the rule 'flange beyond 5 m"):
        design(replace(kuka, workspace=(kuka.workspace[0], high)))
    left, right = half_space("flange", (0.0, 1.0, 0.0), 0.3), half_space("flange", (0.0, -1.0, 0.0), 0.3)
    with pytest.raises(InputError, match="can't be met together.*0.3 m along.*and.*0.3 m along"):
        design(replace(kuka, workspace=(kuka.workspace[0], left, right)))


def test_poses_in_a_narrow_corner_are_found(kuka: Robot) -> None:
    corner = box("flange", (0.9, 0.5, 1.0), (1.0, 0.6, 1.1), inside=True)
    poses = allowed_poses(replace(kuka, workspace=(corner,)), count=5)
    p = kuka.rigid.frame_position(poses, "flange")
    assert np.all(corner.margin(p) > 0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"criterion": "d-optimum"}, "did you mean 'd-optimal'"),
        ({"harmonics": 800}, "at most 60"),
        ({"harmonics": 40, "sample_rate": 7.5}, "40 harmonics.*sample rate above 8 Hz"),
        ({"sample_rate": 150.04}, "whole number"),
        ({"harmonics": 0}, "harmonics = 0"),
        ({"effects": ["stribek@joint_1"]}, "stribek"),
    ],
)
def test_options_that_cannot_be(kuka: Robot, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        design(kuka, **options)  # type: ignore[arg-type]


def test_zero_variance(kuka: Robot) -> None:
    noise = replace(kuka.noise, torque_variance=np.array([400.0, 0.0, 160.0]))
    with pytest.raises(InputError, match="torque_variance of joint 'joint_2' = 0"):
        design(replace(kuka, noise=noise))


def test_assumed_noise_is_said_in_the_file(gantry: Robot) -> None:
    noise = replace(gantry.noise, torque_variance=np.array([np.nan, 0.04]))
    found = design(replace(gantry, noise=noise), base_frequency=0.25, harmonics=3, starts=1, workers=1)
    assert "slide" in found.notes[0]
    assert found.excitation.achieved["notes"] == list(found.notes)


def test_random_trajectories_are_worse(kuka: Robot, random_excitation: Callable[..., Excitation]) -> None:
    structure = Structure.build(kuka)
    assert min(evaluate(structure, random_excitation(k)).log10_det_covariance for k in range(5)) > PAPER
