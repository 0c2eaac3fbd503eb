"""What no certificate covers is said first, and fails `check` and `design` until somebody accepts it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.limits.certifier import Certifier
from robot_ident.model.structure import Structure
from robot_ident.provenance import config_file
from robot_ident.robot import load_robot
from robot_ident.robot.robot_file import builtin_robots
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries

Run = Callable[..., Any]
URDF = config_file("robots", "kuka_ir361.urdf")
REST = "self_collision: {check: false}\nworkspace: []\n"
SHORT = ("--starts", 1, "--time-limit", 4, "--harmonics", 2)


def write_robot(folder: Path, rest: str = "", torque: str = "torque: 400") -> Path:
    """Write the KUKA with limits of its joints; `rest` is what else its YAML says."""
    joint = f"{{position: [-1.2, 1.2], velocity: 1.4, acceleration: 3.0, {torque}}}"
    joints = "".join(f"  joint_{k}: {joint}\n" for k in (1, 2, 3))
    path = folder / "robot.yaml"
    path.write_text(
        f"schema: robot_ident/robot/1\nname: arm\nurdf: {URDF}\nend_effector: flange\njoints:\n{joints}{rest}"
    )
    return path


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    a, b = 0.1 * np.random.default_rng(0).normal(size=(2, 3, 5))
    series = FourierSeries(0.1, np.array([0.0, 0.5, 0.5]), a, b)
    path = tmp_path / "excitation.yaml"
    Excitation("arm", ("joint_1", "joint_2", "joint_3"), series, 150.0).write(path)
    return path


@pytest.mark.parametrize("name", builtin_robots())
def test_nothing_of_the_built_in_robots_is_unchecked(name: str) -> None:
    assert Certifier(load_robot(name)).unknown == ()


def test_check_fails_until_it_is_accepted(run: Run, motion: Path, tmp_path: Path) -> None:
    robot = write_robot(tmp_path)
    both = "self-collision (no collision geometry in the URDF); surroundings (no workspace rule)"
    done = run("check", motion, "--robot", robot)
    assert done.code == 3
    assert done.out.splitlines()[0] == f"not checked: {both}"
    assert done.out.count("not checked") == 1
    assert "every limit that was checked is kept" in done.out
    assert done.err.strip() == (
        f"robot_ident check: not checked: {both}; write the facts into the robot YAML, or give --accept-unchecked"
    )
    accepted = run("check", motion, "--robot", robot, "--accept-unchecked")
    assert (accepted.code, accepted.err, accepted.out) == (0, "", done.out)
    data = run("check", motion, "--robot", robot, "--json")
    assert data.code == 3
    assert data.json["not_checked"] == both.split("; ")


def test_what_the_yaml_says_is_checked(run: Run, motion: Path, tmp_path: Path) -> None:
    done = run("check", motion, "--robot", write_robot(tmp_path, REST), "--json")
    assert (done.code, done.json["not_checked"]) == (0, [])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "workspace: []",
            "workspace:\n  - {kind: half_space, normal: [0, 0, 1], guess: true}",
            "beyond 0 m along [0.0, 0.0, 1.0]' is true (guess: true in workspace)",
        ),
        ("acceleration: 3.0, ", "", "acceleration of joint_1, joint_2, joint_3"),
    ],
)
def test_guesses_and_missing_limits(run: Run, motion: Path, tmp_path: Path, old: str, new: str, said: str) -> None:
    robot = write_robot(tmp_path, REST)
    robot.write_text(robot.read_text().replace(old, new))
    done = run("check", motion, "--robot", robot)
    assert done.code == 3
    assert said in done.out.splitlines()[0]


def test_a_torque_limit_that_nobody_knows(run: Run, motion: Path, tmp_path: Path) -> None:
    endless = tmp_path / "endless.urdf"
    endless.write_text(URDF.read_text().replace('effort="393"', 'effort="0"'))
    robot = write_robot(tmp_path, REST, torque="gear_ratio: 1")
    robot.write_text(robot.read_text().replace(str(URDF), str(endless)))
    done = run("check", motion, "--robot", robot, "--json")
    assert (done.code, done.json["not_checked"]) == (3, ["torque of joint_1"])


def test_a_broken_limit_comes_before_what_is_unchecked(run: Run, motion: Path, tmp_path: Path) -> None:
    robot = write_robot(tmp_path)
    robot.write_text(robot.read_text().replace("velocity: 1.4", "velocity: 0.001"))
    done = run("check", motion, "--robot", robot, "--accept-unchecked")
    assert done.code == 3
    assert "breaks its limit" in done.err


def test_design_writes_its_file_all_the_same(run: Run, tmp_path: Path) -> None:
    robot, file = write_robot(tmp_path), tmp_path / "designed.yaml"
    done = run("design", "--robot", robot, *SHORT, "-o", file)
    assert done.code == 3
    assert done.out.startswith("not checked: self-collision")
    accept = f"robot_ident check {file} --robot {robot} --accept-unchecked"
    assert done.err.strip().splitlines()[-1].endswith(f"into the robot YAML, or accept it: {accept}")
    assert run(*accept.split()[1:]).code == 0
    assert Excitation.read(file).robot == "arm"
    accepted = run("design", "--robot", robot, *SHORT, "-o", file, "--force", "--accept-unchecked", "--json")
    assert accepted.code == 0
    assert accepted.json["not_checked"][1] == "surroundings (no workspace rule)"


def test_a_joint_that_follows_another_is_not_checked(tmp_path: Path, motion: Path, run: Run) -> None:
    """A parallelogram's joint stands still in the model: where the arm beyond it is, no certificate knows."""
    path = write_robot(tmp_path, REST)
    urdf = URDF.read_text(encoding="utf-8").replace(
        "</robot>",
        "<link name='follower'><inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/>"
        "</inertial></link><joint name='rod' type='revolute'><parent link='base'/><child link='follower'/>"
        "<axis xyz='0 0 1'/><limit lower='-3' upper='3' effort='9' velocity='9'/><mimic joint='joint_2'/></joint>"
        "</robot>",
    )
    (tmp_path / "arm.urdf").write_text(urdf, encoding="utf-8")
    text = path.read_text(encoding="utf-8").replace(f"urdf: {URDF}", "urdf: arm.urdf") + "locked: {rod: 0}\n"
    path.write_text(text, encoding="utf-8")
    found = run("check", motion, "--robot", path)
    assert found.code == 3
    assert found.out.startswith("not checked: where rod and all beyond it are (it follows joint_2")
    assert any("rod follows joint_2" in note for note in Structure.build(load_robot(path)).notes)
