"""Robots and trajectories for the tests of the excitation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.robot import Robot, load_robot


@pytest.fixture(scope="session")
def kuka() -> Robot:
    return load_robot("kuka_ir361")


@pytest.fixture(scope="session")
def random_excitation(kuka: Robot) -> Callable[..., Excitation]:
    """Return a maker of random trajectories of the KUKA, scaled to reach a share of its joint limits."""

    def make(seed: int, share: float = 0.9) -> Excitation:
        rng = np.random.default_rng(seed)
        q0, a, b = rng.uniform(-0.3, 0.3, 3), rng.normal(size=(3, 5)), rng.normal(size=(3, 5))
        series = FourierSeries(0.1, q0, a, b)
        q, dq, ddq = series.extremes()
        limits = kuka.limits
        used = np.max(
            [
                (q.upper - q0) / (limits.upper - q0),
                (q0 - q.lower) / (q0 - limits.lower),
                dq.largest / limits.velocity,
                ddq.largest / limits.acceleration,
            ],
            axis=0,
        )
        factor = (share / used)[:, None]
        return Excitation("kuka_ir361", kuka.joints, FourierSeries(0.1, q0, a * factor, b * factor), 150.0)

    return make


@pytest.fixture(scope="session")
def gantry(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a slide that carries a turning arm, with limits for both joints."""
    folder: Path = tmp_path_factory.mktemp("gantry")
    (folder / "gantry.urdf").write_text(GANTRY_URDF, encoding="utf-8")
    (folder / "gantry.yaml").write_text(GANTRY_YAML, encoding="utf-8")
    return load_robot(folder / "gantry.yaml")


@pytest.fixture(scope="session")
def ur10(robots_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a UR10 with the meshes of its links and all limits."""
    path: Path = tmp_path_factory.mktemp("ur10") / "ur10.yaml"
    path.write_text(UR10_YAML, encoding="utf-8")
    return load_robot(path)


UR10_YAML = """schema: robot_ident/robot/1
name: ur10
urdf: package://example-robot-data/robots/ur_description/urdf/ur10_robot.urdf
joints:
  shoulder_pan_joint: {acceleration: 5, position: [-3, 3], torque_variance: 25}
  shoulder_lift_joint: {acceleration: 5, position: [-3, 3], torque_variance: 25}
  elbow_joint: {acceleration: 5, position: [-3, 3], torque_variance: 9}
  wrist_1_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
  wrist_2_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
  wrist_3_joint: {acceleration: 8, position: [-3, 3], torque_variance: 1}
"""

GANTRY_URDF = """<?xml version="1.0"?>
<robot name="gantry">
  <link name="base"/>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.6" effort="400"/>
  </joint>
  <link name="carriage">
    <inertial><mass value="8"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
  </link>
  <joint name="arm" type="revolute">
    <parent link="carriage"/><child link="beam"/><origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-2.5" upper="2.5" velocity="2" effort="60"/>
  </joint>
  <link name="beam">
    <inertial><origin xyz="0.2 0 0.05"/><mass value="3"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial>
  </link>
  <joint name="tip_joint" type="fixed"><parent link="beam"/><child link="tip"/><origin xyz="0.4 0 0"/></joint>
  <link name="tip"/>
</robot>
"""

GANTRY_YAML = """schema: robot_ident/robot/1
name: gantry
urdf: gantry.urdf
end_effector: tip
joints:
  slide: {acceleration: 2.0, torque_variance: 4.0}
  arm: {acceleration: 6.0, torque_variance: 0.04}
workspace:
  - {kind: half_space, normal: [0, 0, 1], offset: 0.1}
"""
