"""Numbers of a URDF that Pinocchio would take as they are, and that make no robot."""

from __future__ import annotations

from pathlib import Path

import pytest

from robot_ident.errors import InputError
from robot_ident.robot import load_robot

URDF = """<robot name="arm"><link name="base"/>
  <link name="one"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="tool"/>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="one"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="3" effort="100"/></joint>
  <joint name="flange" type="fixed"><origin xyz="0 0 0.2"/><parent link="one"/><child link="tool"/>
    <axis xyz="0 0 0"/></joint></robot>"""


def load(tmp_path: Path, old: str, new: str) -> None:
    assert old in URDF
    (tmp_path / "arm.urdf").write_text(URDF.replace(old, new))
    load_robot(tmp_path / "arm.urdf")


def test_a_fixed_joint_needs_no_axis(tmp_path: Path) -> None:
    load(tmp_path, "arm", "arm")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "joint 'hinge': the axis '0 0 0' has no direction"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1e-200 0"/>', "has no direction"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="nan 0 1"/>', "joint 'hinge': <axis xyz='nan 0 1'>: 3 numbers"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>', "3 numbers"),
        ('<mass value="2"/>', '<mass value="inf"/>', "link 'one': <mass value='inf'>: 1 numbers"),
        ('<mass value="2"/>', '<mass value="two"/>', "<mass value='two'>"),
        ('ixx="0.1"', 'ixx="1e300"', "<inertia ixx='1e300'>"),
        ('<origin xyz="0 0 0.1"/>', '<origin xyz="0 0 0.1 0"/>', "3 numbers"),
        ('<origin xyz="0 0 0.2"/>', '<origin xyz="0 0 0.2" rpy="0 0 -90"/>', "radians were expected, and these are"),
    ],
)
def test_numbers_that_make_no_robot(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, old, new)
    assert message in str(caught.value)
