"""Motions and robots for the tests of the simulated robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries

PERIOD = 4.0


@dataclass(frozen=True)
class Blend:
    """A Fourier series that starts from rest: its amplitude grows smoothly over the first period."""

    series: FourierSeries
    duration: float

    @property
    def start_pose(self) -> Array:
        return np.asarray(self.series.q0)

    def reference(self, t: Array) -> Motion:
        period = self.series.period
        m, x = self.series.motion(t), np.clip(np.asarray(t) / period, 0.0, 1.0)[:, None]
        s, ds = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2 / period
        dds = 60 * x * (1 - x) * (1 - 2 * x) / period**2
        q = m.q - self.series.q0
        return Motion(self.series.q0 + s * q, s * m.dq + ds * q, s * m.ddq + 2 * ds * m.dq + dds * q)


MakeBlend = Callable[[Robot, float], Blend]


@pytest.fixture
def blend() -> MakeBlend:
    """Return a maker of periodic motions (period 4 s) of a given duration for a robot."""

    def make(robot: Robot, duration: float) -> Blend:
        rng = np.random.default_rng(3)
        a, b = rng.normal(0.0, 0.3, (2, robot.n, 3))
        return Blend(FourierSeries(1 / PERIOD, np.full(robot.n, 0.1), a, b), duration)

    return make


@pytest.fixture(scope="session")
def kuka() -> Robot:
    return load_robot("kuka_ir361")


@pytest.fixture(scope="session")
def kuka_spring() -> Robot:
    return load_robot("kuka_ir361_spring")


FRICTION = "simulation:\n  viscous: {{{viscous}}}\n  coulomb: {{{coulomb}}}\n"


def _with_friction(folder: Path, name: str, urdf: Path, joints: list[str], coulomb: float) -> Robot:
    """Return a robot of a URDF with friction on its joints."""
    viscous = ", ".join(f"{j}: {coulomb / 2}" for j in joints)
    dry = ", ".join(f"{j}: {coulomb}" for j in joints)
    listed = "\n".join(f"  {j}: {{}}" for j in joints)
    text = f"schema: robot_ident/robot/1\nname: {name}\nurdf: {urdf}\njoints:\n{listed}\n"
    path = folder / f"{name}.yaml"
    path.write_text(text + FRICTION.format(viscous=viscous, coulomb=dry))
    return load_robot(path)


SLIDER = """<robot name="slider"><link name="base"/>
<link name="cart"><inertial><mass value="3"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="pole"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="100" velocity="3"/></joint>
<joint name="swing" type="revolute"><parent link="cart"/><child link="pole"/><axis xyz="0 1 0"/>
<limit lower="-6" upper="6" effort="50" velocity="9"/></joint></robot>"""


@pytest.fixture(scope="session", params=["ur5", "panda", "slider"])
def arm(request: pytest.FixtureRequest, robots_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A 6-axis arm, a 7-axis arm and a prismatic joint with a pendulum, all with friction."""
    folder = tmp_path_factory.mktemp("arms")
    if request.param == "ur5":
        urdf = robots_folder / "ur_description/urdf/ur5_joint_limited_robot.urdf"
        joints = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
        return _with_friction(folder, "ur5", urdf, [f"{j}_joint" for j in joints], 1.0)
    if request.param == "panda":
        urdf = robots_folder / "panda_description/urdf/panda.urdf"
        return _with_friction(folder, "panda", urdf, [f"panda_joint{k}" for k in range(1, 8)], 0.5)
    urdf = folder / "slider.urdf"
    urdf.write_text(SLIDER)
    return _with_friction(folder, "slider", urdf, ["slide", "swing"], 2.0)
