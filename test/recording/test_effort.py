"""What "effort" means is declared: current, motor side, sign, coupling, gravity taken out, each turned into torque."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.errors import InputError
from robot_ident.recording import Recording
from robot_ident.recording.effort import as_reported, at_the_joints
from robot_ident.robot import Robot
from robot_ident.robot.robot_file import definition_of
from robot_ident.signals.motion import Motion


@pytest.fixture(scope="module")
def kuka() -> Robot:
    return Robot.load()


@pytest.fixture
def declared(kuka: Robot, tmp_path: Path) -> Any:
    """Return a function that writes the KUKA with another `effort` and reads it."""
    definition = definition_of(kuka)

    def write(effort: Any, **joints: dict[str, Any]) -> Robot:
        data = {**definition.yaml, "urdf": "arm.urdf", "effort": effort}
        data["joints"] = {name: {**record, **joints.get(name, {})} for name, record in data["joints"].items()}
        (tmp_path / "arm.urdf").write_text(definition.urdf)
        (tmp_path / "arm.yaml").write_text(yaml.safe_dump(data, sort_keys=False))
        return Robot.load(tmp_path / "arm.yaml")

    return write


@pytest.fixture(scope="module")
def torque() -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, 50.0, (20, 3))


def recorded(robot: Robot, effort: np.ndarray) -> Recording:
    q = np.random.default_rng(1).normal(0.0, 1.0, effort.shape)
    return Recording(robot.joints, np.arange(len(effort)) / 150.0, q, effort)


def test_torque_on_the_joint_side_stays_as_it_is(kuka: Robot, torque: Any) -> None:
    recording = recorded(kuka, torque)
    assert at_the_joints(recording, kuka) is recording


def test_current_becomes_torque(declared: Any, torque: Any) -> None:
    robot = declared("current")
    constant = robot.drives.torque_constant
    found = at_the_joints(recorded(robot, torque / constant), robot)
    np.testing.assert_allclose(found.tau, torque, rtol=1e-12)
    assert any("taken as current" in note for note in found.notes)


def test_a_curve_stands_for_a_constant(declared: Any) -> None:
    robot = declared("current", joint_1={"torque_curve": [[1.0, 20.0], [2.0, 30.0]]})
    effort = np.array([[0.5, 0, 0], [-1.5, 0, 0], [3, 0, 0]])
    torque = at_the_joints(recorded(robot, effort), robot).tau
    np.testing.assert_allclose(torque[:, 0], [10.0, -25.0, 40.0])
    np.testing.assert_allclose(as_reported(torque, np.zeros((3, 3)), robot), effort, atol=1e-12)


def test_motor_side_sign_and_unit(declared: Any, torque: Any) -> None:
    robot = declared(
        {"side": "motor", "gain": 0.001},
        joint_1={"gear_ratio": 100.0},
        joint_2={"gear_ratio": 50.0, "effort": {"sign": -1}},
        joint_3={"effort": {"side": "joint", "gain": 1.0}},
    )
    found = at_the_joints(recorded(robot, torque), robot).tau
    np.testing.assert_allclose(found, torque * [0.1, -0.05, 1.0])


def test_coupled_drives(declared: Any, torque: Any) -> None:
    coupling = [[1.0, 0.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.5, 1.0]]
    robot = declared({"coupling": coupling})
    found = at_the_joints(recorded(robot, torque), robot).tau
    np.testing.assert_allclose(found, torque @ np.array(coupling).T)


def test_gravity_that_the_driver_takes_out_is_put_back(declared: Any, torque: Any) -> None:
    robot = declared("torque", joint_2={"effort": {"gravity": "removed"}})
    recording = recorded(robot, torque)
    still = np.zeros_like(recording.q)
    gravity = robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    found = at_the_joints(recording, robot)
    np.testing.assert_allclose(found.tau, torque + gravity * [0.0, 1.0, 0.0])
    assert any("joint_2, is put back" in note for note in found.notes)


def test_a_drive_of_unknown_gain_keeps_the_ampere(declared: Any, torque: Any) -> None:
    robot = declared("current")
    drives = replace(robot.drives, torque_constant=np.array([np.nan, 2.0, 3.0]))
    bare = replace(robot, drives=drives)
    found = at_the_joints(recorded(bare, torque), bare)
    np.testing.assert_allclose(found.tau, torque * [1.0, 2.0, 3.0])
    assert bare.ampere_joints == ("joint_1",)
    assert [bare.torque_unit(j) for j in range(3)] == ["A", "Nm", "Nm"]
    assert any("no drive gain is known of joint_1" in note for note in found.notes)


def test_what_is_reported_is_the_inverse(declared: Any, torque: Any) -> None:
    robot = declared(
        {"quantity": "current", "side": "motor", "gravity": "removed", "coupling": [[1, 0, 0], [0, 1, 0], [0, 1, 1]]},
        joint_1={"gear_ratio": 120.0, "effort": {"sign": -1}},
        joint_2={"gear_ratio": 80.0, "torque_curve": [[10.0, 0.2], [20.0, 0.3]]},
    )
    recording = recorded(robot, torque)
    effort = as_reported(torque, recording.q, robot)
    np.testing.assert_allclose(at_the_joints(replace(recording, tau=effort), robot).tau, torque, atol=1e-9)


@pytest.mark.parametrize(
    ("effort", "told"),
    [
        ("amps", "effort.quantity = 'amps'"),
        ({"sign": 2}, "effort.sign = 2"),
        ({"quantity": "current", "side": "link"}, "a link-side sensor reports a torque"),
        ({"coupling": [[1, 0], [0, 1]]}, "effort.coupling must be 3 x 3"),
        ({"coupling": [[1, 0, 0], [0, 1, 1], [0, 1, 1]]}, "the drives don't move all joints"),
        ({"quantitiy": "torque"}, "unknown key 'effort.quantitiy'"),
    ],
)
def test_a_mistake_is_named(declared: Any, effort: Any, told: str) -> None:
    with pytest.raises(InputError, match="arm.yaml: .*") as caught:
        declared(effort)
    assert told in str(caught.value)


def test_weight_is_not_put_back_into_unknown_amperes(declared: Any) -> None:
    """Nm beside A would look like a clock that runs wrong."""
    with pytest.raises(InputError, match="effort of joint_2: gravity: removed needs torque_constant or torque_curve"):
        declared({"quantity": "current", "gravity": "removed"}, joint_2={"torque_constant": None})
