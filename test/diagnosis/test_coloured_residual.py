"""What the model lacks has the motion's own frequencies: an effect must explain more of it than it would by chance."""

from __future__ import annotations

import numpy as np
import pytest

from robot_ident.diagnosis.diagnose import diagnose
from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.model.structure import Structure
from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array

URDF = """<robot name="slide"><link name="base"/><link name="carriage"><inertial><mass value="90"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1" effort="200"/></joint></robot>"""
DT, LENGTH = 0.01, 3000


@pytest.fixture(scope="module")
def slide(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    folder = tmp_path_factory.mktemp("slide")
    (folder / "slide.urdf").write_text(URDF, encoding="utf-8")
    path = folder / "robot.yaml"
    path.write_text("schema: robot_ident/robot/1\nname: slide\nurdf: slide.urdf\n", encoding="utf-8")
    return load_robot(path)


def found_in(robot: Robot, torque: Array, q: Array, ddq: Array, rng: np.random.Generator, periods: int) -> Diagnosis:
    dq = np.gradient(q, DT)
    one = 90.0 * ddq + 200.0 * dq + 20.0 * np.sign(dq) + torque
    tau = np.tile(one, periods) + rng.normal(0.0, 1.0, periods * LENGTH)
    t, q = DT * np.arange(len(tau)), np.tile(q, periods)
    recording = Recording(robot.joints, t, q[:, None], tau[:, None], source="run")
    once = Processing(periodic=False, low_pass=10.0)
    averaged = Processing(base_frequency=1.0 / (LENGTH * DT))
    measured = process(recording, robot, averaged if periods > 1 else once)
    return diagnose([measured], Structure.build(robot, ["torque_offset@slide"]), as_declared=True)


@pytest.mark.parametrize(
    ("seed", "periods"),
    [(0, 1), *(pytest.param(*one, marks=pytest.mark.long) for one in ((1, 1), (2, 1), (3, 1), (0, 4), (7, 4)))],
)
def test_a_disturbance_of_an_effect_s_spectrum_is_not_named(slide: Robot, seed: int, periods: int) -> None:
    """The effect itself, of the same size on the same motion, is; one period has no noise of its own, four have."""
    rng = np.random.default_rng(seed)
    t, turn = DT * np.arange(LENGTH), 2.0 * np.pi / 6.0
    phases = rng.uniform(0.0, 6.0, 3)
    q = sum(a * np.sin(k * turn * t + p) for k, a, p in zip((1, 2, 3), (0.15, 0.05, 0.03), phases, strict=True))
    if periods == 1:
        q = q + 0.02 * np.cumsum(rng.normal(0.0, 0.01, LENGTH))
        q = np.convolve(q, np.hanning(31) / np.hanning(31).sum(), mode="same")
    ddq = np.gradient(np.gradient(q, DT), DT)
    effect = 30.0 * np.abs(np.gradient(q, DT)) / np.abs(np.gradient(q, DT)).max()
    lines = np.fft.rfft(effect)
    turned = lines * np.exp(2j * np.pi * rng.uniform(size=len(lines)) * (np.arange(len(lines)) > 0))
    named = [one.label for one in found_in(slide, effect, q, ddq, rng, periods).missing]
    other = [one.label for one in found_in(slide, np.fft.irfft(turned, LENGTH), q, ddq, rng, periods).missing]
    assert named == ["viscous_asymmetric@slide"]
    assert other == []
