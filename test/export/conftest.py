"""Models with known values, of any robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot

Make = Callable[..., Model]

GANTRY = """<robot name="gantry">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="rail"><inertial><mass value="500"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  </link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="carriage"/>
    <origin xyz="0.1 0 0.5" rpy="0.3 0.2 -0.4"/><axis xyz="0.6 0 0.8"/>
    <limit lower="-1" upper="1" velocity="2" effort="500"/></joint>
  <link name="carriage">
    <visual><geometry><mesh filename="package://gantry/carriage.dae"/></geometry><material name="grey"/></visual>
    <collision><geometry><box size="0.1 0.2 0.3"/></geometry></collision>
    <inertial><origin xyz="0.1 -0.05 0.02" rpy="0.5 0 0.2"/><mass value="20"/>
      <inertia ixx="0.5" ixy="0.02" ixz="0.01" iyy="0.6" iyz="-0.03" izz="0.7"/></inertial>
  </link>
  <joint name="bolt" type="fixed"><parent link="carriage"/><child link="motor"/>
    <origin xyz="0 0.2 0.1" rpy="0.1 0 0"/></joint>
  <link name="motor"><inertial><mass value="4"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
  <joint name="hinge" type="continuous"><parent link="carriage"/><child link="arm"/>
    <origin xyz="0.3 0.1 0" rpy="1.2 -0.3 0.7"/><axis xyz="0 1 0"/></joint>
  <link name="arm"><inertial><origin xyz="0.3 0 0.1"/><mass value="6"/>
    <inertia ixx="0.1" ixy="0.01" ixz="0" iyy="0.4" iyz="0.02" izz="0.4"/></inertial></link>
  <joint name="wrist" type="revolute"><parent link="arm"/><child link="hand"/>
    <origin xyz="0.6 0 0" rpy="0 0.4 1.5707963267948966"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-2" upper="2" velocity="2" effort="30"/></joint>
  <link name="hand"><inertial><origin xyz="0 0.1 0"/><mass value="2"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.02"/></inertial></link>
  <joint name="finger" type="prismatic"><parent link="hand"/><child link="tip"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.1" velocity="1" effort="10"/><dynamics damping="3"/></joint>
  <link name="tip"><inertial><mass value="0.3"/>
    <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
</robot>
"""
GANTRY_YAML = """schema: robot_ident/robot/1
name: gantry
urdf: gantry.urdf
gravity: [0, 0, -9.81]
joints:
  slide: {armature: 3.0}
  hinge: {armature: 0.5}
locked: {wrist: 0.7, finger: 0.05}
simulation:
  viscous: {slide: 12.0, hinge: 1.5}
  coulomb: {slide: 7.0, hinge: 0.8}
"""


@pytest.fixture
def gantry(tmp_path: Path) -> Robot:
    """Return a slide with a hinge, a motor bolted to it, a locked wrist and finger."""
    (tmp_path / "gantry.urdf").write_text(GANTRY)
    (tmp_path / "gantry.yaml").write_text(GANTRY_YAML)
    return Robot.load(tmp_path / "gantry.yaml")


@pytest.fixture
def make() -> Make:
    """Return a function from a robot to the model that has its true values (or those given)."""

    def model(robot: Robot, effects: Sequence[str] = (), values: np.ndarray | None = None) -> Model:
        structure = Structure.build(robot, effects)
        found = np.concatenate([structure.true_values(), structure.settings]) if values is None else values
        size = np.maximum(np.abs(found), 1.0) * 1e-3
        fits = {joint: Fit(1.0, 1.0, 1.0, 0.1) for joint in robot.joints}
        noise = NoiseLevel((1.0,) * robot.n, (0.0,) * robot.n, 1, 1)
        return Model(structure, found, np.diag(size**2), "wls", noise, fits, 1.0, 0.0)

    return model
