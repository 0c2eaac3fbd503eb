"""`identify` stops where data contradict the declaration of effort, names the entry, and never on a right one."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robot_ident.bags import write_recording
from robot_ident.cli.main import main
from robot_ident.estimation.contradiction import Contradiction, contradiction, coupling_contradiction
from robot_ident.estimation.declaration import judge_all
from robot_ident.recording import Processing, Recording, process
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.drives import Effort, Efforts, EffortSource
from robot_ident.signals.motion import Motion


@pytest.fixture(scope="module")
def recording(arm: Any) -> Any:
    return arm.record(1, periods=3, lead=0.0)


def found(recording: Recording, robot: Robot) -> Contradiction | None:
    return contradiction(judge_all([process(recording, robot)], robot), robot)


def declared(robot: Robot, **words: Any) -> Robot:
    return replace(robot, effort=Efforts(Effort(**words)))


def test_a_right_declaration_stands(arm: Any, recording: Any) -> None:
    assert found(recording, arm.robot) is None


@pytest.mark.parametrize("wrong", [0.4, 0.7, 1.5, 2.5])
def test_masses_of_a_urdf_may_be_wrong(arm: Any, recording: Any, wrong: float) -> None:
    assert found(replace(recording, tau=recording.tau * wrong), arm.robot) is None


def test_current_declared_as_torque(arm: Any, recording: Any) -> None:
    ampere = replace(recording, tau=recording.tau / arm.robot.drives.torque_constant)
    told = found(ampere, arm.robot)
    assert told is not None
    assert (told.entry, told.now) == ("effort.quantity", "torque")
    assert told.change.startswith("effort: current, with torque_constant")
    assert found(ampere, declared(arm.robot, quantity="current")) is None


def test_some_joints_tell_the_unit_of_all_that_come_by_one_message(arm: Any, recording: Any) -> None:
    """The first joint's share holds a rotor that the URDF lacks: a half of its torque, which alone tells nothing."""
    told = found(replace(recording, tau=recording.tau * [0.5, 0.08, 0.09]), arm.robot)
    assert told is not None
    assert told.entry == "effort.quantity"
    assert told.change.startswith("effort: current for all joints of the message, with torque_constant by joint")
    assert set(told.share) == {"joint_2", "joint_3"}
    nm = found(replace(recording, tau=recording.tau * [0.08, 0.08, 1.0]), arm.robot)
    assert nm is not None
    assert nm.change.startswith("joint_1: {effort: current}, joint_2: {effort: current}"), (
        "joint 3 lifts its weight in Nm"
    )
    elsewhere = replace(arm.robot, effort=Efforts(sources={"joint_1": EffortSource("/other")}))
    apart = found(replace(recording, tau=recording.tau * [0.5, 0.08, 0.09]), elsewhere)
    assert apart is not None
    assert "all joints" not in apart.change


def test_torque_declared_as_current(arm: Any, recording: Any) -> None:
    told = found(recording, declared(arm.robot, quantity="current"))
    assert told is not None
    assert (told.entry, told.change) == ("effort.quantity", "effort: torque")


def test_all_signs_turned_and_one(arm: Any, recording: Any) -> None:
    told = found(replace(recording, tau=-recording.tau), arm.robot)
    assert told is not None
    assert (told.entry, told.change) == ("effort.sign", "effort: {sign: -1}")
    told = found(replace(recording, tau=recording.tau * [1.0, -1.0, 1.0]), arm.robot)
    assert told is not None
    assert (told.entry, told.change) == ("joints.joint_2.effort.sign", "joint_2: {effort: {sign: -1}}")


def test_a_wrong_coupling_is_told_as_one(arm: Any, recording: Any) -> None:
    """Drive 2 moves joint 3 as well: declared with the wrong sign or not at all, not where a drive's sign is wrong."""
    true = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.8, 1.0]])
    reported = replace(recording, tau=np.linalg.solve(true, recording.tau.T).T)

    def told(reported: Recording, coupling: np.ndarray) -> Contradiction | None:
        robot = replace(arm.robot, effort=Efforts(coupling=coupling))
        return coupling_contradiction([process(reported, robot)], robot)

    assert told(reported, true) is None
    assert told(replace(reported, tau=reported.tau * [1.0, -1.0, 1.5]), true) is None, "a sign, or a gain"
    for wrong in (np.abs(true), np.eye(3)):
        one = told(reported, wrong)
        assert one is not None
        assert one.entry == "effort.coupling"
        rows = yaml.safe_load(one.change)["effort"]["coupling"]
        np.testing.assert_allclose(rows, true, atol=0.1)
    assert coupling_contradiction([process(recording, arm.robot)], arm.robot) is None, "none is declared"


def test_joints_of_their_own_are_changed_where_they_stand(arm: Any, recording: Any) -> None:
    single = {"joint_2": Effort(gain=10.0), "joint_3": Effort(gain=0.01)}
    strong = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(3, np.inf)))
    told = found(recording, replace(strong, effort=Efforts(by_joint=single)))
    assert told is not None
    assert told.entry == "joints.joint_2.effort.gain"
    assert told.change == "joint_2: {effort: {gain: 1}}, joint_3: {effort: {gain: 1}}"
    told = found(recording, replace(arm.robot, effort=Efforts(by_joint={"joint_2": Effort(quantity="current")})))
    assert told is not None
    assert told.change == "joint_2: {effort: torque}"
    told = found(recording, replace(arm.robot, effort=Efforts(by_joint={j: Effort(sign=-1) for j in arm.robot.joints})))
    assert told is not None
    assert told.change.startswith("joint_1: {effort: {sign: 1}}, joint_2: {effort: {sign: 1}}")


def test_motor_side(arm: Any, recording: Any) -> None:
    geared = replace(arm.robot, drives=replace(arm.robot.drives, gear_ratio=np.array([100.0, 80.0, 60.0])))
    motor = replace(recording, tau=recording.tau / geared.drives.gear_ratio)
    told = found(motor, geared)
    assert told is not None
    assert (told.entry, told.change) == ("effort.side", "effort: {side: motor}")
    assert found(motor, declared(geared, side="motor")) is None


def test_another_unit(arm: Any, recording: Any) -> None:
    strong = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(3, np.inf)))
    told = found(replace(recording, tau=1000.0 * recording.tau), strong)
    assert told is not None
    assert (told.entry, told.change) == ("effort.gain", "effort: {gain: 0.001}")


def test_gravity_that_the_driver_takes_out(arm: Any, recording: Any) -> None:
    still = np.zeros_like(recording.q)
    gravity = arm.robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    compensated = replace(recording, tau=recording.tau - gravity)
    told = found(compensated, arm.robot)
    assert told is not None
    assert (told.entry, told.change) == ("effort.gravity", "effort: {gravity: removed}")
    assert found(compensated, declared(arm.robot, gravity="removed")) is None
    told = found(recording, declared(arm.robot, gravity="removed"))
    assert told is not None
    assert told.change == "effort: {gravity: included}"


def without_weight(arm: Any, recording: Recording) -> np.ndarray:
    still = np.zeros_like(recording.q)
    weight: np.ndarray = arm.robot.rigid.inverse_dynamics(Motion(recording.q, still, still))
    return recording.tau - weight


def test_gravity_taken_out_of_turned_efforts_and_of_scaled_ones(arm: Any, recording: Any) -> None:
    """All of it stands in one advice, which makes the data agree with the declaration."""
    compensated = without_weight(arm, recording)
    turned = replace(recording, tau=-compensated)
    told = found(turned, arm.robot)
    assert told is not None
    assert (told.entry, told.change) == ("effort.gravity", "effort: {gravity: removed, sign: -1}")
    assert found(turned, declared(arm.robot, gravity="removed", sign=-1)) is None
    told = found(turned, declared(arm.robot, sign=-1))
    assert told is not None
    assert told.change == "effort: {sign: -1, gravity: removed}"
    told = found(turned, declared(arm.robot, gravity="removed"))
    assert told is not None
    assert told.change == "effort: {gravity: removed, sign: -1}", "inertia tells a sign where weight was put back"
    told = found(replace(recording, tau=-recording.tau), declared(arm.robot, gravity="removed"))
    assert told is not None
    assert told.change == "effort: {gravity: included, sign: -1}", "what is put back cancels the weight"
    twice = replace(recording, tau=2.0 * compensated - recording.tau)
    assert found(twice, declared(arm.robot, gravity="removed")) is None
    partly = Efforts(by_joint={"joint_1": Effort(gravity="removed", sign=-1)})
    told = found(turned, replace(arm.robot, effort=partly))
    assert told is not None
    own = "{effort: {gravity: removed, sign: -1}}"
    assert told.change == f"joint_2: {own}, joint_3: {own}", "joint 1 is right"
    thousandth = replace(recording, tau=1000.0 * compensated)
    strong = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(3, np.inf)))
    told = found(thousandth, declared(strong, gain=0.001))
    assert told is not None
    assert told.change == "effort: {gain: 0.001, gravity: removed}"


def test_amperes_without_weight(checkout: Path) -> None:
    robot = load_robot(checkout / "test/golden/inputs/six_axis.yaml")
    t, rng = np.arange(0.0, 20.0, 0.01), np.random.default_rng(3)
    w, size, phase = (rng.uniform(*bounds, size=(5, 6)) for bounds in ((0.3, 3.5), (0.1, 0.35), (0.0, 6.0)))
    angle = w * t[:, None, None] + phase
    q, dq, ddq = (np.sum(size * x, axis=1) for x in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    constant = np.array([12.0, 12.0, 11.0, 9.5, 9.7, 9.2])
    rigid, weight = (robot.rigid.inverse_dynamics(Motion(q, *x)) for x in ((dq, ddq), (0.0 * q, 0.0 * q)))
    recording = Recording(robot.joints, t, q, (rigid - weight + 5.0 * dq + 3.0 * np.sign(dq)) / constant, source="A")
    told = found(recording, robot)
    assert told is not None
    assert told.change.startswith("effort: {gravity: removed, quantity: current}"), told.change
    assert "torque_constant by joint" in told.change and "joint_2 12" in told.change
    told = found(recording, declared(robot, quantity="current"))
    assert told is not None
    assert told.change.startswith("effort: {quantity: current, gravity: removed}, with torque_constant by joint")
    assert "can't be put back" in told.told(robot)
    known = replace(robot, drives=replace(robot.drives, torque_constant=constant))
    assert found(recording, declared(known, quantity="current", gravity="removed")) is None


def test_an_advice_holds_what_is_declared_and_is_never_given_twice(arm: Any, recording: Any) -> None:
    strong = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(3, np.inf)))
    thousandth = replace(recording, tau=-1000.0 * recording.tau)
    told = found(thousandth, declared(strong, sign=-1))
    assert told is not None
    assert told.change == "effort: {sign: -1, gain: 0.001}"
    apart = replace(recording, tau=recording.tau * [118.0, 118.0, 1.04e4])
    for gain in (1.0, 0.001, 0.1):
        told = found(apart, declared(strong, gain=gain))
        assert told is not None
        if told.entry == "effort.gain":
            assert told.change == "" and "no one gain explains all joints" in told.look
            assert "gear_ratio" in told.look and "masses" in told.look
    coupled = Efforts(Effort(), topic="/arm/states", coupling=np.eye(3))
    told = found(replace(recording, tau=1000.0 * recording.tau), replace(strong, effort=coupled))
    assert told is not None
    assert yaml.safe_load(told.change)["effort"] == {
        "gain": 0.001,
        "topic": "/arm/states",
        "coupling": np.eye(3).tolist(),
    }


def test_a_gain_that_is_no_unit_is_not_said_to_be_one(arm: Any, recording: Any) -> None:
    strong = replace(arm.robot, limits=replace(arm.robot.limits, torque=np.full(3, np.inf)))
    one = replace(recording, tau=recording.tau * [1.0, 1.0, 43.4])
    told = found(one, replace(strong, drives=replace(strong.drives, gear_ratio=np.ones(3))))
    assert told is not None
    assert told.change.startswith("joint_3: {effort: {gain: 0.02")
    assert "side: motor" in told.look and "masses" in told.look
    geared = replace(strong, drives=replace(strong.drives, gear_ratio=np.array([100.0, 80.0, 43.0])))
    told = found(one, geared)
    assert told is not None
    assert told.change == "joint_3: {effort: {gain: 0.0233}}"
    assert "joint_3 seems to be multiplied by gear_ratio already" in told.look
    told = found(replace(recording, tau=recording.tau / [1.0, 1.0, 43.0]), geared)
    assert told is not None
    assert told.change == "joint_3: {effort: {side: motor}}"


def test_friction_behind_the_gear(arm: Any, recording: Any) -> None:
    told = found(recording, declared(arm.robot, side="link"))
    assert told is not None
    assert told.change == "effort: {side: joint}"
    assert "friction, which a link-side sensor hardly feels" in told.in_words
    assert min(told.share.values()) > 0.2 and max(told.share.values()) < 1.0


def test_real_recordings_are_what_their_files_say(shared_data: Path, checkout: Path, tmp_path: Path) -> None:
    z = np.load(shared_data / "emps/data.npz")
    emps = Recording(("slide",), z["t"], z["q"], z["tau"], source="emps")
    robot = load_robot(checkout / "examples/emps/robot.yaml")
    assert found(emps, robot) is None
    assert found(replace(emps, tau=-emps.tau), robot) is not None
    shutil.copy(checkout / "examples/staubli_tx40/robot.yaml", tmp_path)
    shutil.copy(shared_data / "staubli_tx40/tx40_mdh_modified.urdf", tmp_path)
    robot = load_robot(tmp_path / "robot.yaml")
    z = np.load(shared_data / "staubli_tx40/data.npz")
    tx40 = Recording(robot.joints, z["t"], z["q"], z["tau"], source="tx40")
    judged = judge_all([process(tx40, robot, Processing(low_pass=100.0, decimate=10))], robot)
    assert contradiction(judged, robot) is None, "rotors that the URDF lacks make four times its inertia"


def test_identify_stops_with_the_line_to_change(
    arm: Any, recording: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(arm.robot.source).read_text(encoding="utf-8")
    shutil.copy(Path(arm.robot.source).with_suffix(".urdf"), tmp_path)
    lines = [*text.splitlines(), "effort:", "  sign: 1"]
    robot, bag, model = tmp_path / "arm.yaml", tmp_path / "bag.npz", tmp_path / "model.yaml"
    robot.write_text("\n".join(lines), encoding="utf-8")
    write_recording(bag, replace(recording, tau=-recording.tau))
    words = ["identify", str(bag), "--robot", str(robot), "-o", str(model)]
    assert main(words) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert f"{robot}:{len(lines)}: effort.sign is 1" in told
    assert "change it to 'effort: {sign: -1}'" in told
    assert not model.exists()
    assert main([*words, "--as-declared"]) == 0
    assert "taken as declared" in capsys.readouterr().err
    robot.write_text("\n".join([*lines[:-1], "  sign: -1"]), encoding="utf-8")
    assert main([*words, "--force"]) == 0
    assert "contradict" not in capsys.readouterr().err
