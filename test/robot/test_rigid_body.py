"""The regressor and its symbolic twin against Pinocchio, on arms of 3, 6 and 7 axes."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio
import pytest

from robot_ident.robot import Robot, load_robot
from robot_ident.robot.symbolic import frame_function, regressor_expression
from robot_ident.signals.motion import Motion

PANDA = """
schema: robot_ident/robot/1
name: panda
urdf: {urdf}
joints: {{{joints}}}
"""

PRISMATIC = """<robot name="gantry">
  <link name="base"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="a"/><origin xyz="0 0.1 0.2" rpy="0.3 0 0.1"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="10"/></joint>
  <link name="a"><inertial><origin xyz="0.1 0.2 0.3"/><mass value="3"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0.02" iyy="0.2" iyz="0.03" izz="0.3"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.3 0 0.1" rpy="0 0.4 0"/>
    <axis xyz="0.6 0 0.8"/></joint>
  <link name="b"><inertial><origin xyz="0.2 -0.1 0.1"/><mass value="2"/>
    <inertia ixx="0.2" ixy="0.02" ixz="-0.01" iyy="0.1" iyz="0.01" izz="0.15"/></inertial></link>
  <joint name="lift" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 0 0.2" rpy="0 0 1"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="10"/></joint>
  <link name="c"><inertial><origin xyz="0.05 0 0.1"/><mass value="1"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
</robot>"""


def _robot(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    if name.startswith("kuka"):
        return load_robot(name)
    if name == "gantry":
        (tmp_path / "gantry.urdf").write_text(PRISMATIC)
        return load_robot(tmp_path / "gantry.urdf")
    folder: Path = request.getfixturevalue("robots_folder")
    if name == "ur10":
        return load_robot(folder / "ur_description/urdf/ur10_robot.urdf")
    urdf = folder / "panda_description/urdf/panda.urdf"
    joints = ", ".join(f"panda_joint{k}: {{armature: 0.{k}}}" for k in range(1, 8))
    (tmp_path / "panda.yaml").write_text(PANDA.format(urdf=urdf, joints=joints))
    return load_robot(tmp_path / "panda.yaml")


@pytest.fixture(params=["kuka_ir361", "kuka_ir361_spring", "gantry", "ur10", "panda"])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Robot:
    return _robot(request.param, request, tmp_path)


@pytest.fixture
def motion(robot: Robot) -> Motion:
    return Motion(*np.random.default_rng(3).uniform(-2, 2, (3, 40, robot.n)))


def test_regressor_times_parameters_is_rnea(robot: Robot, motion: Motion) -> None:
    data = robot.rigid.model.createData()
    rnea = [
        pinocchio.rnea(robot.rigid.model, data, *state) for state in zip(motion.q, motion.dq, motion.ddq, strict=True)
    ]
    tau = robot.rigid.regressor(motion) @ robot.rigid.parameters + robot.drives.armature * motion.ddq
    np.testing.assert_allclose(tau, rnea, atol=1e-10)
    np.testing.assert_allclose(robot.rigid.inverse_dynamics(motion), rnea, atol=1e-12)


def test_symbolic_regressor_is_pinocchios(robot: Robot, motion: Motion) -> None:
    state = [ca.SX.sym(name, robot.n) for name in ("q", "dq", "ddq")]
    regressor = ca.Function("regressor", state, [regressor_expression(robot, *state)])
    symbolic = regressor.map(motion.samples)(motion.q.T, motion.dq.T, motion.ddq.T)
    expected = robot.rigid.regressor(motion)
    got = np.array(symbolic).reshape(robot.n, motion.samples, 10 * robot.n).transpose(1, 0, 2)
    np.testing.assert_allclose(got, expected, atol=1e-10 * np.abs(expected).max())


def test_frame_function_is_forward_kinematics(robot: Robot, motion: Motion) -> None:
    symbolic = np.array(frame_function(robot, robot.end_effector).map(motion.samples)(motion.q.T)).T
    np.testing.assert_allclose(symbolic, robot.rigid.frame_position(motion.q, robot.end_effector), atol=1e-12)


def test_arm_stands_straight_up_at_zero_and_tilts_forward() -> None:
    robot = load_robot()
    up, forward = robot.rigid.frame_position(np.array([[0.0, 0, 0], [0, 0.5, 0.5]]), "flange")
    np.testing.assert_allclose(up, [0, 0, 1.02 + 0.48 + 0.765], atol=1e-12)
    assert forward[0] == pytest.approx(0.48 * np.sin(0.5) + 0.765 * np.sin(1.0))
    assert forward[1] == pytest.approx(0, abs=1e-12)


def test_prismatic_and_continuous_joints_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "gantry.urdf").write_text(PRISMATIC)
    robot = load_robot(tmp_path / "gantry.urdf")
    assert robot.prismatic == (True, False, True)
    assert np.isinf(robot.limits.upper[1])
    assert robot.torque_unit(0) == "N"
