"""What the effort means is seen against the rigid model: torque, current, opposite sign, gravity taken out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.declaration import judge_declaration
from robot_ident.recording import Recording
from robot_ident.robot import load_robot
from robot_ident.robot.drives import Effort, Efforts
from robot_ident.signals.motion import Motion


@pytest.fixture(scope="module")
def recording(arm: Any) -> Any:
    return arm.record(1, periods=3, lead=0.0)


def verdicts(recording: Any, robot: Any) -> list[str]:
    return [one.verdict for one in judge_declaration(recording, robot)]


def test_torque_as_declared(arm: Any, recording: Any) -> None:
    found = judge_declaration(recording, arm.robot)
    assert [one.verdict for one in found] == ["consistent"] * 3
    for one in found:
        assert abs(one.share - 1.0) < 4 * one.std < 0.4


def test_current_declared_as_torque(arm: Any, recording: Any) -> None:
    ampere = replace(recording, tau=recording.tau / arm.robot.drives.torque_constant)
    found = judge_declaration(ampere, arm.robot)
    assert [one.verdict for one in found] == ["factor"] * 3
    np.testing.assert_allclose([one.share for one in found], 1 / arm.robot.drives.torque_constant, rtol=0.2)
    assert verdicts(ampere, replace(arm.robot, effort=Efforts(Effort("current")))) == ["consistent"] * 3


def test_one_joint_with_the_opposite_sign(arm: Any, recording: Any) -> None:
    turned = replace(recording, tau=recording.tau * [1.0, -1.0, 1.0])
    assert verdicts(turned, arm.robot) == ["consistent", "sign", "consistent"]


def test_twice_the_gain(arm: Any, recording: Any) -> None:
    found = judge_declaration(replace(recording, tau=recording.tau * [1.0, 1.0, 2.2]), arm.robot)
    assert [one.verdict for one in found] == ["consistent", "consistent", "factor"]
    assert "2.2" in found[2].hint


def test_gravity_taken_out(arm: Any, recording: Any) -> None:
    still = np.zeros_like(recording.q)
    gravity = arm.robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    found = verdicts(replace(recording, tau=recording.tau - gravity), arm.robot)
    assert found == ["consistent", "compensated", "compensated"], "axis 1 stands upright and carries none"


def test_a_joint_whose_load_is_lost_in_noise(arm: Any, recording: Any) -> None:
    rng = np.random.default_rng(0)
    quiet = replace(recording, tau=0.02 * recording.tau + rng.normal(0, 400.0, recording.tau.shape) * [1.0, 0.0, 0.0])
    assert verdicts(quiet, arm.robot)[0] == "not_told"


def test_time_that_runs_backwards_is_seen_in_friction(arm: Any, recording: Any) -> None:
    backwards = replace(recording, q=recording.q[::-1], tau=recording.tau[::-1])
    found = judge_declaration(backwards, arm.robot)
    assert [one.verdict for one in found] == ["driven"] * 3
    assert all(one.friction < 0 for one in found)


def test_a_joint_whose_urdf_takes_hardly_any_torque_is_not_judged(arm: Any, recording: Any) -> None:
    """What friction and the rotor make is no share of the URDF's torque, whatever sign and size fit best."""
    motion = arm.series.motion(recording.t - recording.t[0])
    v, a = motion.dq[:, 2], motion.ddq[:, 2]
    rng = np.random.default_rng(0)
    model = arm.robot.rigid.inverse_dynamics(Motion(motion.q, motion.dq, motion.ddq))
    tau = np.array(recording.tau)
    tau[:, 2] = 0.02 * model[:, 2] + 20.0 * a + 10.0 * v + 30.0 * np.sign(v) + rng.normal(size=len(v))
    found = judge_declaration(replace(recording, tau=tau), arm.robot)
    assert [one.verdict for one in found] == ["consistent", "consistent", "not_told"]


def test_a_rotor_that_the_urdf_lacks_does_not_bend_the_factor(arm: Any, recording: Any) -> None:
    """In A, an estimate that leaves the rotor out would give half the torque constant or less."""
    motion = arm.series.motion(recording.t - recording.t[0])
    constant = np.array([20.0, 25.0, 15.0])
    model = arm.robot.rigid.inverse_dynamics(Motion(motion.q, motion.dq, motion.ddq))
    rotor = [20.0, 10.0, 4.0] * motion.ddq + 10.0 * motion.dq + 20.0 * np.sign(motion.dq)
    rng = np.random.default_rng(0)
    tau = (model + rotor + rng.normal(size=model.shape)) / constant
    robot = replace(
        arm.robot,
        effort=Efforts(Effort("current")),
        drives=replace(arm.robot.drives, torque_constant=np.full(3, np.nan)),
    )
    for one, true in zip(judge_declaration(replace(recording, tau=tau), robot), constant, strict=True):
        assert one.verdict == "factor"
        assert 1.0 / one.share == pytest.approx(true, rel=0.05), one
        assert "+-" in one.hint


def test_gravity_that_points_up(arm: Any, recording: Any) -> None:
    still = np.zeros_like(recording.q)
    weight = arm.robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    found = judge_declaration(replace(recording, tau=recording.tau - 2.0 * weight), arm.robot)
    assert [one.verdict for one in found] == ["consistent", "sign", "sign"]
    assert "does gravity point the wrong way" in found[1].hint


@pytest.mark.parametrize("gain", [1.0, 0.6])
def test_the_weight_of_a_vertical_slide_is_like_an_offset(tmp_path: Path, gain: float) -> None:
    """It never changes along the motion: inertia alone tells a gain, and that may hold a rotor that the URDF lacks."""
    path = tmp_path / "lift.urdf"
    path.write_text(
        """<robot name="lift"><link name="column"/><joint name="z" type="prismatic"><parent link="column"/>
        <child link="fork"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="500" velocity="2"/></joint>
        <link name="fork"><inertial><mass value="8"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
        </inertial></link></robot>"""
    )
    t = np.arange(4000)[:, None] / 200.0
    q, dq, ddq = 0.3 * np.sin(2.0 * t), 0.6 * np.cos(2.0 * t), -1.2 * np.sin(2.0 * t)
    noise = np.random.default_rng(0).normal(size=(2, *t.shape))
    tau = gain * (8.0 * (ddq + 9.81) + 3.0 * dq) + 0.05 * noise[0]
    (found,) = judge_declaration(Recording(("z",), t[:, 0], q + 1e-6 * noise[1], tau, source="lift"), load_robot(path))
    assert np.isnan(found.gravity)
    assert found.inertia == pytest.approx(gain, rel=0.02)
    assert found.verdict == ("consistent" if gain == 1.0 else "factor")
