"""A recording's sidecar: recordings share the arm's parameters and differ by the payload and gravity that it states."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import read_for, read_recording, write_recording
from robot_ident.errors import InputError
from robot_ident.recording import Recording, process
from robot_ident.recording.checks import reach_of, refuse_payload
from robot_ident.recording.conditions import Conditions, KnownPayload, PayloadPart, hand, read_conditions, sidecar
from robot_ident.robot import Robot, load_robot
from robot_ident.robot.rigid_body import RigidBody
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.calibrate import standard_motions
from robot_ident.trajectories.fourier_series import FourierSeries

TILTED = (1.5, -2.0, -9.0)
BODY = KnownPayload(3.0, (0.05, -0.02, 0.1), (0.02, 0.001, 0.03, -0.002, 0.003, 0.025))


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def series(robot: Robot) -> FourierSeries:
    return standard_motions(robot)[0]


def periods_of(robot: Robot, series: FourierSeries, torque: Array, conditions: Conditions) -> Recording:
    """Return two periods at 100 Hz whose torque [N, n] is that of one."""
    t = np.arange(2 * len(torque)) / 100.0
    return Recording(robot.joints, t, series.motion(t).q, np.tile(torque, (2, 1)), conditions=conditions)


def one_period(series: FourierSeries) -> Motion:
    return series.motion(np.arange(round(100 * series.period)) / 100.0)


def heavier(robot: Robot, body: KnownPayload) -> RigidBody:
    """Return the arm with a body on its hand, by Pinocchio's own sum of inertias."""
    import pinocchio

    rotation, origin = hand(robot)
    xx, xy, yy, xz, yz, zz = body.inertia
    own = pinocchio.Inertia(body.mass, np.array(body.centre), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    model = robot.rigid.model.copy()
    placed = pinocchio.SE3(rotation, origin).act(own)
    model.inertias[robot.n] = model.inertias[robot.n] + placed
    return RigidBody(model)


def test_a_payload_s_torque_is_what_the_heavier_arm_needs_more(robot: Robot, series: FourierSeries) -> None:
    motion = one_period(series)
    more = heavier(robot, BODY).inverse_dynamics(motion) - robot.rigid.inverse_dynamics(motion)
    np.testing.assert_allclose(BODY.torque(robot, motion), more, atol=1e-9)


def test_a_known_payload_is_taken_off(robot: Robot, series: FourierSeries) -> None:
    motion = one_period(series)
    recording = periods_of(robot, series, heavier(robot, BODY).inverse_dynamics(motion), Conditions(BODY))
    measured = process(recording, robot)
    alone = robot.rigid.inverse_dynamics(measured.motion)
    assert np.abs(measured.torque - alone).max() < 0.01
    assert any("payload of 3 kg taken off" in note for note in measured.notes)
    forgotten = process(replace(recording, conditions=Conditions()), robot)
    assert np.abs(forgotten.torque - alone).max() > 5.0


def test_a_base_that_stood_otherwise_shares_the_arm_s_parameters(robot: Robot, series: FourierSeries) -> None:
    """The columns take the recording's gravity, and what the usual pose never shows is the URDF's."""
    from robot_ident.model.structure import Structure

    motion = one_period(series)
    tilted = robot.rigid.inverse_dynamics(replace(motion, gravity=TILTED))
    assert np.abs(tilted - robot.rigid.inverse_dynamics(motion)).max() > 5.0
    measured = process(periods_of(robot, series, tilted, Conditions(gravity=TILTED)), robot)
    structure = Structure.build(robot)
    rigid = structure.base.values(robot.rigid.parameters, robot.drives.armature)
    armature = robot.drives.armature * measured.motion.ddq
    free = [joint for joint in range(robot.n) if joint in structure.base.free_rotors]
    expected = structure.rigid_columns(measured.motion) @ rigid
    expected[:, free] += armature[:, free]
    assert np.abs(measured.torque - expected).max() < 0.01


def test_the_sidecar_is_read_with_its_bag(robot: Robot, series: FourierSeries, tmp_path: Path) -> None:
    recording = periods_of(robot, series, robot.rigid.inverse_dynamics(one_period(series)), Conditions())
    told = Conditions(BODY, tool="gripper", gravity=TILTED, temperature=31.0, day="2026-03-01", note="after lunch")
    for bag in (tmp_path / "run", tmp_path / "run.npz"):
        write_recording(bag, recording)
        assert read_recording(bag).conditions == Conditions()
        sidecar(bag).write_text(told.text(), encoding="utf-8")
        assert sidecar(bag).name == f"{bag.name}.conditions.yaml"
        assert read_recording(bag).conditions == told
        part = PayloadPart(5.0, (0.0, 0.1, 0.0))
        named = Conditions(estimated=True, body="box")
        for unknown in (Conditions(estimated=True), named, replace(named, part=part)):
            sidecar(bag).write_text(unknown.text(), encoding="utf-8")
            assert read_recording(bag).conditions == unknown
            sidecar(bag).unlink()


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("payload: {mass: -1}", "payload"),
        ("payload: {mass: 1, inertia: [1, 0, 1, 0, 0, 5]}", "no body has these moments"),
        ("payload: {estimate: ''}", "payload.estimate"),
        ("payload: {estimate: box, mas: 5}", "unknown key 'payload.mas'"),
        ("payload: {estimate: box, mass: -5}", "payload.mass = -5"),
        ("payload: {estimate: box, mass: 5, inertia: [1, 0, 1, 0, 0, 5]}", "no body has these moments"),
        ("payload: {estimate: box, mass: 5, centre: [0, 0, 0], inertia: [1, 0, 1, 0, 0, 1]}", "are all given"),
        ("payload: {mass: 5, centre: estimate}", "left out beside a name: payload: {estimate: box, mass: 2.0}"),
        ("payload: {mass: 5, centre: [20, 0, 80]}", "lies 82.5 m from the flange: millimetres? write [0.02, 0, 0.08]"),
        ("payload: {estimate: box, centre: [20, 0, 80]}", "82.5 m from the flange: millimetres? write [0.02, 0, 0.08]"),
        ("payload: heavy", "yaml: payload = 'heavy': "),
        ("payload: {mass: 5 kg}", "yaml: payload.mass = '5 kg': "),
        ("payload: {mas: 5}", "'payload.mass' is missing; unknown key 'payload.mas'"),
        ("gravity: [0, 0, 0]", "gravity = [0.0, 0.0, 0.0]"),
        ("gravity: [0, 0, -1]", "m/s^2 in the base's frame was expected"),
        ("gravity: [0, 0, -9810]", "m/s^2 in the base's frame was expected"),
        ("temprature: 20", "unknown key 'temprature'"),
        ("day: yesterday", "day = 'yesterday'"),
    ],
)
def test_a_mistake_is_named(tmp_path: Path, line: str, told: str) -> None:
    path = sidecar(tmp_path / "bag")
    path.write_text(f"schema: robot_ident/conditions/1\n{line}\n", encoding="utf-8")
    with pytest.raises(InputError, match="bag.conditions.yaml") as caught:
        read_conditions(tmp_path / "bag")
    assert told in str(caught.value)


@pytest.mark.parametrize("name", ["a.npz", "a.csv", "a.mcap", "a"])
def test_a_sidecar_by_the_name_without_its_ending(tmp_path: Path, name: str) -> None:
    text = "schema: robot_ident/conditions/1\ntool: gripper\n"
    (tmp_path / "a.conditions.yaml").write_text(text, encoding="utf-8")
    assert read_conditions(tmp_path / name).tool == "gripper"
    assert read_conditions(tmp_path / "a.2.npz").tool == "", "a dot within a name ends nothing"
    if name != "a":
        (tmp_path / f"{name}.conditions.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(
            InputError, match=f"{name}: its conditions stand in .*{name}.conditions.yaml and in .*keep one"
        ):
            read_conditions(tmp_path / name)


def test_what_a_sidecar_leaves_out_of_a_payload_is_said(robot: Robot, series: FourierSeries, tmp_path: Path) -> None:
    bag = tmp_path / "run.npz"
    write_recording(bag, periods_of(robot, series, robot.rigid.inverse_dynamics(one_period(series)), Conditions()))
    told = {}
    for text in ("mass: 2", "mass: 2, centre: [0, 0, 0]", "mass: 2, centre: [0, 0, 0], inertia: [0, 0, 0, 0, 0, 0]"):
        sidecar(bag).write_text(f"schema: robot_ident/conditions/1\npayload: {{{text}}}\n", encoding="utf-8")
        read = read_conditions(bag)
        told[text] = next(note for note in process(read_for(bag, robot), robot).notes if "payload" in note)
        sidecar(bag).write_text(read.text(), encoding="utf-8")
        assert read_conditions(bag) == read, "nothing is stated that was not"
    first, second, third = told.values()
    assert str(bag) in first
    assert "origin of the end effector's frame and no inertia about it assumed: give centre: [x, y, z] m" in first
    assert "{estimate: box, mass: 2}" in first
    assert "no inertia about its centre assumed" in second
    assert "assumed" not in third


def test_a_centre_beyond_the_arm_s_own_length_is_refused(robot: Robot, tmp_path: Path) -> None:
    reach = reach_of(robot)
    assert 1.0 < reach < 2.0
    for centre, far in ((0.9 * reach, False), (1.1 * reach, True)):
        stated = Conditions(KnownPayload(2.0, (0.0, 0.0, centre)))
        if not far:
            refuse_payload(stated, robot, "bag")
            continue
        with pytest.raises(InputError, match="bag.conditions.yaml: centre: .* millimetres.*the whole arm is"):
            refuse_payload(stated, robot, "bag")


def test_a_mass_that_no_robot_carries_is_refused(robot: Robot) -> None:
    with pytest.raises(InputError, match="bag.conditions.yaml: payload.mass = 1e\\+09 kg: no robot carries that"):
        refuse_payload(Conditions(KnownPayload(1e9, (0.0, 0.0, 0.1))), robot, "bag")


def test_a_payload_beyond_a_joint_that_follows_another_is_refused(tmp_path: Path) -> None:
    def joint(number: int, more: str = "") -> str:
        return (
            f"<joint name='j{number}' type='revolute'><parent link='l{number - 1}'/><child link='l{number}'/>"
            "<origin xyz='0.4 0 0'/><axis xyz='0 1 0'/>"
            f"<limit lower='-1' upper='1' velocity='1' effort='9'/>{more}</joint>"
        )

    mass = "<inertial><mass value='1'/><inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial>"
    links = "".join(f"<link name='l{k}'>{mass}</link>" for k in range(4))
    joints = joint(1) + joint(2) + joint(3, "<mimic joint='j2' multiplier='-1'/>")
    (tmp_path / "arm.urdf").write_text(f"<robot name='p'>{links}{joints}</robot>", encoding="utf-8")
    path = tmp_path / "arm.yaml"
    path.write_text("schema: robot_ident/robot/1\nname: p\nurdf: arm.urdf\nlocked: {j3: 0}\n", encoding="utf-8")
    arm = load_robot(path)
    refuse_payload(Conditions(), arm, "bag")
    for stated in (Conditions(KnownPayload(2.0)), Conditions(estimated=True)):
        with pytest.raises(InputError, match="can't hold a payload: on the way to the flange j3 follows another joint"):
            refuse_payload(stated, arm, "bag")
    path.write_text("schema: robot_ident/robot/1\nname: p\nurdf: arm.urdf\nlocked: {j2: 0, j3: 0}\n", encoding="utf-8")
    refuse_payload(Conditions(KnownPayload(2.0)), load_robot(path), "bag")  # the one that it follows stands still, too
