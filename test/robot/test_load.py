"""Robot files: what is in them, and one clear line about what is wrong in them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.provenance import config_file
from robot_ident.robot import load_robot


@pytest.fixture
def kuka(tmp_path: Path) -> Path:
    for name in ("kuka_ir361.yaml", "kuka_ir361.urdf"):
        shutil.copy(config_file("robots", name), tmp_path)
    return tmp_path / "kuka_ir361.yaml"


def _edit(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def test_kuka_has_the_papers_limits_and_noise() -> None:
    robot = load_robot()
    np.testing.assert_array_equal(robot.limits.upper, [1.6, 1.2, 1.2])
    np.testing.assert_array_equal(robot.limits.acceleration, [3, 3, 3])
    np.testing.assert_allclose(robot.noise.torque_variance / 16, [25, 26, 10])
    np.testing.assert_allclose(robot.noise.position_variance / 16, [1.1223e-10, 8.2822e-11, 2.9061e-10])
    assert robot.known_effects == ()
    assert robot.definition is None


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("velocity: 1.45", "velocity: -1.45", ["velocity", "-1.45", "greater than 0"]),
        ("armature: 4.0", "armatur: 4.0", ["joints.joint_1.armatur"]),
        ("end_effector: flange", "end_effector: flang", ["flang", "flange"]),
        ("joint_2: {position", "joint_9: {position", ["joint_9"]),
        ("[-1.6, 1.6]", "[1.6, -1.6]", ["lower limit"]),
        ("p1: Izz1", "p1: Izz2", ["base_parameters"]),
        ("p1: Izz1", "p1: Izz7", ["Izz7"]),
        ("urdf: kuka_ir361.urdf", "urdf: kuka.urdf", ["kuka.urdf", "no such file"]),
        ("urdf: kuka_ir361.urdf", f"urdf: {'k' * 300}.urdf", ["kkk"]),  # longer than a file's name may be
        ("radius: 0.7", "radius: .nan", ["radius"]),
        ("offset: 0.8", "offset: high", ["offset", "high"]),
        ("gravity: [0, 0, -9.81]", "gravity: [0, 0, -1.0e+200]", ["gravity", "1e+200"]),
    ],
)
def test_a_mistake_gives_one_line_with_field_and_value(kuka: Path, old: str, new: str, words: list[str]) -> None:
    from robot_ident.model.structure import Structure

    _edit(kuka, old, new)
    with pytest.raises(InputError) as caught:
        Structure.build(load_robot(kuka))
    text = str(caught.value)
    assert "\n" not in text
    assert str(kuka.parent) in text
    for word in words:
        assert word in text


def test_all_problems_are_said_at_once(kuka: Path) -> None:
    _edit(kuka, "armature: 4.0", "armature: -4.0")
    _edit(kuka, "torque_variance: 416", "torque_variance: 0")
    with pytest.raises(InputError, match=r"armature.*torque_variance"):
        load_robot(kuka)


def test_unknown_robot_suggests_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'kuka_ir361"):
        load_robot("kuka_ir_361")


def test_joints_left_out_are_locked(kuka: Path) -> None:
    text = kuka.read_text()
    start, end = text.index("  joint_3:"), text.index("workspace:")
    text = text[:start] + "locked: {joint_3: 0.4}\n\n" + text[end:]
    text = text[: text.index("base_parameters:")]
    kuka.write_text(text)
    robot = load_robot(kuka)
    assert robot.joints == ("joint_1", "joint_2")
    straight = load_robot().rigid.frame_position(np.array([[0.1, 0.2, 0.4]]), "flange")
    np.testing.assert_allclose(robot.rigid.frame_position(np.array([[0.1, 0.2]]), "flange"), straight, atol=1e-12)


def test_a_branching_tree_is_refused_with_the_way_out(robots_folder: Path) -> None:
    with pytest.raises(InputError, match="list one chain under 'joints'"):
        load_robot(robots_folder / "panda_description/urdf/panda.urdf")
