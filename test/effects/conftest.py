"""Robots and motions on which every effect of the catalogue is tried."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest

from robot_ident.effects import CATALOGUE, Effect, Torques
from robot_ident.model.structure import Structure
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries

PENDULUM = """
<robot name="pendulum">
  <link name="base"/>
  <link name="arm"><inertial><origin xyz="0.3 0.0 0"/><mass value="10"/>
    <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0.4"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="3" effort="200"/></joint>
</robot>"""


def periodic_motion(series: FourierSeries, samples: int, *, periodic: bool = True) -> Motion:
    """Return a period at samples half a step off its start, where a series of cosines turns."""
    dt = series.period / samples
    m = series.motion((np.arange(samples) + 0.5) * dt)
    return Motion(m.q, m.dq, m.ddq, dt=dt, periodic=periodic)


@dataclass(frozen=True)
class Case:
    """A robot with a model of it, on a motion and on one that retraces its path, q(-t) = q(t)."""

    robot: Robot
    structure: Structure
    values: Array
    motion: Motion
    mirrored: Motion

    @classmethod
    def of(cls, robot: Robot) -> Case:
        structure = Structure.build(robot)
        rng = np.random.default_rng(7)
        a, b = 0.25 * rng.normal(size=(2, robot.n, 5))
        series = FourierSeries(0.1, 0.3 * rng.normal(size=robot.n), a, b)
        values = structure.true_values().copy()
        # friction of the size of the arm, where the robot's YAML gives none
        for k, parameter in enumerate(structure.parameters):
            if parameter.effect in ("viscous", "coulomb") and values[k] == 0.0:
                values[k] = 2.0
        mirrored = replace(series, a=np.zeros_like(a))
        return cls(robot, structure, values, periodic_motion(series, 600), periodic_motion(mirrored, 600))

    @cached_property
    def torques(self) -> Torques:
        """The model's torques along the motion."""
        return self.structure.torques(self.motion, self.values)

    @cached_property
    def mirrored_torques(self) -> Torques:
        """The model's torques along the motion that retraces its path."""
        return self.structure.torques(self.mirrored, self.values)

    def effects(self, name: str) -> Iterator[Effect]:
        """Yield an effect at every place where the robot can have it."""
        kind = CATALOGUE[name]
        joints: list[int | None] = list(range(self.robot.n)) if kind.scope != "robot" else []
        whole: list[int | None] = [None] if kind.scope != "joint" else []
        for place in (*joints, *whole):
            if name == "payload" or not kind.available(self.robot, place):
                yield kind(self.robot, place)


@pytest.fixture(scope="session")
def kuka() -> Case:
    return Case.of(load_robot())


@pytest.fixture(scope="session")
def six_axes(robots_folder: Path) -> Case:
    """Return a UR5 with gear ratios."""
    robot = load_robot(robots_folder / "ur_description/urdf/ur5_robot.urdf")
    return Case.of(replace(robot, drives=replace(robot.drives, gear_ratio=np.full(6, 101.0))))


@pytest.fixture(scope="session")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return one revolute axis across gravity: 1.3 kg m^2, 10 kg at 0.3 m."""
    path = tmp_path_factory.mktemp("pendulum") / "pendulum.urdf"
    path.write_text(PENDULUM)
    return load_robot(path)


@pytest.fixture(scope="session")
def slide(checkout: Path) -> Case:
    """Return one prismatic axis."""
    return Case.of(load_robot(checkout / "examples/emps/robot.yaml"))


@pytest.fixture(scope="session")
def case(kuka: Case, six_axes: Case, slide: Case) -> Callable[[str], Case]:
    return {"kuka": kuka, "six_axes": six_axes, "slide": slide}.__getitem__
