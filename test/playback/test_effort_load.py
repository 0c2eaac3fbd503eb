"""Efforts are held against limits in the limits' own unit, whatever the drives report."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.playback.supervisor import Bounds, EffortLoad, Watch
from robot_ident.robot import Robot, load_robot

JOINTS = ("joint_1", "joint_2", "joint_3")
MS = 1_000_000


def arm(path: Path, checkout: Path, effort: Any, **joints: dict[str, Any]) -> Robot:
    data = {
        "schema": "robot_ident/robot/1",
        "name": "arm",
        "urdf": str(checkout / "config/robots/kuka_ir361.urdf"),
        "effort": effort,
        "joints": {name: joints.get(name, {}) for name in JOINTS},
    }
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return load_robot(path)


def test_currents_become_torques_by_sign_gain_and_ratio(tmp_path: Path, checkout: Path) -> None:
    motor = {"torque": 400.0, "gear_ratio": 100.0, "torque_constant": 0.5, "effort": {"sign": -1, "gain": 0.001}}
    robot = arm(
        tmp_path / "arm.yaml",
        checkout,
        {"quantity": "current", "side": "motor"},
        joint_1=motor,
        joint_2={"torque_curve": [[2.0, 30.0], [4.0, 40.0]], "torque": 90.0, "gear_ratio": 2.0},
        joint_3={"effort": {"quantity": "torque", "side": "joint"}, "torque": 70.0},
    )
    load = EffortLoad(robot)
    np.testing.assert_array_equal(load.bounds, [400.0, 90.0, 70.0])
    assert load.units == ("Nm", "Nm", "Nm") and load.unwatched == ()
    got = load.of(np.array([6000.0, -3.0, 12.0]), np.zeros(3))
    np.testing.assert_allclose(got, [-0.001 * 6000 * 0.5 * 100, -35.0 * 2, 12.0])


def test_drives_of_unknown_gain_are_held_against_their_current(tmp_path: Path, checkout: Path) -> None:
    robot = arm(
        tmp_path / "arm.yaml",
        checkout,
        {"quantity": "current", "gain": 0.001},
        joint_1={"current": 8.0, "torque": 400.0},
        joint_2={"torque": 400.0},
        joint_3={"torque": 400.0, "torque_constant": 10.0},
    )
    load = EffortLoad(robot)
    np.testing.assert_array_equal(load.bounds, [8.0, np.inf, 400.0])
    assert load.units == ("A", "A", "Nm")
    np.testing.assert_allclose(load.of(np.array([9000.0, 1e6, 2000.0]), np.zeros(3)), [9.0, 1000.0, 20.0])
    (line,) = load.unwatched
    assert "joint_2 is not watched" in line and "tracking alone" in line and "`current`" in line and "\n" not in line
    watch = Watch(JOINTS, Bounds(0.2, np.full(3, 0.1), load.bounds), convert=load.of, units=load.units)
    watch.update(JOINTS, np.zeros(3), [7900.0, 1e9, 39000.0], MS, 0.0)
    assert watch.problem(0.0, np.zeros((1, 3))) == ""
    assert watch.worst_share() == (pytest.approx(0.9875), "joint_1", "effort")
    watch.update(JOINTS, np.zeros(3), [8100.0, 1e9, 39000.0], 2 * MS, 0.01)
    assert watch.problem(0.01, np.zeros((1, 3))) == "the effort of joint_1 is 8.1 A (bound 8.0 A)"
    watch.update(JOINTS, np.zeros(3), [0.0, 0.0, -41000.0], 3 * MS, 0.02)
    assert watch.problem(0.02, np.zeros((1, 3))) == "the effort of joint_3 is -410.0 Nm (bound 400.0 Nm)"


def test_a_coupling_with_a_drive_of_unknown_gain_tells_no_torque(tmp_path: Path, checkout: Path) -> None:
    coupling = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]]
    robot = arm(
        tmp_path / "arm.yaml",
        checkout,
        {"quantity": "current", "coupling": coupling},
        joint_1={"torque": 10.0, "torque_constant": 2.0},
        joint_2={"torque": 10.0, "current": 5.0},
        joint_3={"torque": 10.0, "torque_constant": 2.0},
    )
    load = EffortLoad(robot)
    np.testing.assert_array_equal(load.bounds, [10.0, 5.0, np.inf])
    assert load.units == ("Nm", "A", "A")


def test_efforts_that_come_by_messages_of_their_own(tmp_path: Path, checkout: Path) -> None:
    robot = arm(tmp_path / "arm.yaml", checkout, {}, joint_2={"torque": 50.0, "effort": {"topic": "/drives"}})
    load = EffortLoad(robot)
    bounds = Bounds(0.2, np.full(3, 0.1), np.minimum(load.bounds, 1e4))
    watch = Watch(JOINTS, bounds, convert=load.of, units=load.units, elsewhere=("joint_2",))

    def state(now: float) -> str:
        watch.update(JOINTS, np.zeros(3), [1.0, 9e9, 1.0], round(now * 1e9) + MS, now)
        return watch.problem(now, np.zeros((1, 3)))

    assert state(0.0) == "" and watch.unheard == ("joint_2",), "not heard yet is no fault"
    watch.update_efforts({"joint_2": 49.0}, 0.05)
    assert state(0.1) == "" and watch.unheard == ()
    watch.update_efforts({"joint_2": -51.0}, 0.15)
    assert state(0.2) == "the effort of joint_2 is -51.0 Nm (bound 50.0 Nm)"
    watch.update_efforts({"joint_2": 1.0}, 0.25)
    assert state(1.2) == ""
    assert "no effort of joint_2 for 1.05 s" in state(1.3)
    watch.excuse(1.0, 1.3)
    assert state(1.3001) == "", "time stood still for all"
