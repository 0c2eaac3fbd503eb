"""`robot_ident init`: what a URDF and a recording say, what is guessed, what is missing; and the result is a robot."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import BagWriter, Qos, Series, Topic, qos_text
from robot_ident.provenance import config_file
from robot_ident.recording.resolution import position_step
from robot_ident.robot import load_robot

Run = Callable[..., Any]
KUKA = str(config_file("robots", "kuka_ir361.urdf"))


def test_from_a_urdf(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    done = run("init", "--urdf", KUKA, "--acceleration", "3", "-o", str(out), "--mount", "ceiling", "--json")
    data = done.json
    assert data["moving"] == ["joint_1", "joint_2", "joint_3"]
    robot, known = load_robot(out), load_robot()
    np.testing.assert_allclose(robot.limits.acceleration, 3.0)
    np.testing.assert_allclose(robot.limits.velocity, known.limits.velocity)
    np.testing.assert_allclose(robot.rigid.model.gravity.linear, [0, 0, 9.81])
    assert "GUESS" in out.read_text() and not any("acceleration" in what for what in data["missing"])


def test_accelerations_are_asked_for_never_invented(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    done = run("init", "--urdf", KUKA, "-o", str(out))
    assert done.out.count("missing: acceleration limit of joint_") == 3
    assert "# acceleration: VALUE  # MISSING: rad/s^2" in out.read_text()
    assert not np.isfinite(load_robot(out).limits.acceleration).any()


def test_joints_that_are_held(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    run("init", "--urdf", KUKA, "--hold", "joint_3=0.25", "-o", str(out))
    robot = load_robot(out)
    assert robot.joints == ("joint_1", "joint_2")
    straight = tmp_path / "straight.yaml"
    run("init", "--urdf", KUKA, "--hold", "joint_3=0", "-o", str(straight))
    assert not np.allclose(load_robot(straight).rigid.parameters, robot.rigid.parameters)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A driver's bag: the URDF on /robot_description, states of two of the joints and of a gripper, encoder steps."""
    path = tmp_path / "drive"
    t = np.arange(0.0, 4.0, 0.01)
    q = np.stack([0.3 * np.sin(3 * t), 0.2 * np.cos(2 * t), 0.04 + 0 * t], axis=1)
    q[:, :2] = np.round(q[:, :2] / 1e-4) * 1e-4
    states, description = "/arm/joint_states", "/arm/robot_description"
    text = Path(KUKA).read_bytes() + b"\0"
    topics = [
        Topic(states, "sensor_msgs/msg/JointState", qos=qos_text([Qos()])),
        Topic(description, "std_msgs/msg/String", qos=qos_text([Qos(durability="transient_local")])),
    ]
    stamps = 1_700_000_000_000_000_000 + np.rint(1e9 * t).astype(np.int64)
    with BagWriter(path, topics, shown_as=path) as writer:
        message = b"\0\1\0\0" + struct.pack("<I", len(text)) + text
        writer.write(description, message, int(stamps[0]), int(stamps[0]), 1)
        for stamp, topic, row in Series(
            states, ("joint_2", "joint_1", "grip"), stamps, q, None, np.ones_like(q)
        ).messages():
            writer.write(topic, row, stamp)
    return path


def test_from_a_bag_alone(run: Run, bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    data = run("init", "--bag", bag, "-o", out, "--json").json
    assert data["moving"] == ["joint_1", "joint_2"], "in the order of the chain, not of the bag"
    assert data["held"] == {"joint_3": "drive has no such joint"}
    assert (tmp_path / "robot.urdf").read_text() == Path(KUKA).read_text()
    robot = load_robot(out)
    np.testing.assert_allclose(robot.drives.encoder_step, 1e-4, rtol=1e-3)
    steps = [guess for guess in data["guesses"] if "encoder_step" in guess]
    assert steps == [f"encoder_step of {joint}: 0.0001: the smallest step in drive" for joint in data["moving"]]


def two_states(path: Path) -> Path:
    """A cell's bag: the arm's states and, on a topic of like name, the gripper's, both with efforts."""
    t = np.arange(0.0, 4.0, 0.01)
    stamps = 1_700_000_000_000_000_000 + np.rint(1e9 * t).astype(np.int64)
    names = {"/cell/joint_states": ("joint_2", "joint_1", "joint_3"), "/gripper/joint_states": ("finger",)}
    topics = [Topic(name, "sensor_msgs/msg/JointState", qos=qos_text([Qos()])) for name in names]
    with BagWriter(path, topics, shown_as=path) as writer:
        for name, joints in names.items():
            q = np.sin(t)[:, None] * np.linspace(0.1, 0.3, len(joints))
            for stamp, topic, row in Series(name, joints, stamps, q, None, np.ones_like(q)).messages():
                writer.write(topic, row, stamp)
    return path


def test_the_topic_with_the_robots_joints_is_taken_and_kept(run: Run, tmp_path: Path) -> None:
    bag, out = two_states(tmp_path / "cell"), tmp_path / "robot.yaml"
    done = run("init", "--urdf", KUKA, "--bag", bag, "-o", out)
    assert done.code == 0
    assert "/cell/joint_states holds 3 joints of the URDF, /gripper/joint_states (0): its states are taken" in done.err
    assert load_robot(out).effort.topic == "/cell/joint_states"
    assert run("info", bag, "--robot", out).code == 0, "later commands find it"
    named = tmp_path / "named.yaml"
    assert run("init", "--urdf", KUKA, "--bag", bag, "--topic", "cell/joint_states", "-o", named).code == 0
    assert load_robot(named).effort.topic == "/cell/joint_states"


def test_what_is_refused(run: Run, bag: Path, tmp_path: Path) -> None:
    out = str(tmp_path / "robot.yaml")
    for words, why in (
        ([], "--urdf or --bag is needed"),
        (["--urdf", str(tmp_path / "no.urdf")], "no such file"),
        (["--urdf", KUKA, "--acceleration", "1,2"], "1 or 3 finite numbers were expected"),
        (["--urdf", KUKA, "--acceleration", "-1"], "must be above 0"),
        (["--urdf", KUKA, "--hold", "joint_9=0"], "no joint 'joint_9' moves"),
        (["--urdf", KUKA, "--hold", "joint_1"], "JOINT=ANGLE was expected"),
        (["--urdf", KUKA, "--gravity", "0,9.81"], "3 finite numbers were expected"),
    ):
        done = run("init", *words, "-o", out)
        assert done.code == 2 and why in done.err and len(done.err.strip().splitlines()) == 1, done.err
    assert not Path(out).exists()


def test_the_step_of_an_encoder_is_seen() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 20.0, 0.005)
    smooth = 0.5 * np.sin(1.3 * t)
    stepped = np.round(smooth / 2.3e-4) * 2.3e-4
    noisy = np.round((smooth + rng.normal(0, 3e-4, len(t))) / 2.3e-4) * 2.3e-4
    found = position_step(np.stack([smooth, stepped, noisy, 0 * t], axis=1))
    np.testing.assert_allclose(found, [0.0, 2.3e-4, 2.3e-4, 0.0], rtol=1e-6)


def test_a_bag_that_contradicts_the_drafted_effort_is_told(run: Run, arm: Any, tmp_path: Path) -> None:
    from dataclasses import replace

    from robot_ident.bags import write_recording

    record = arm.record(1, periods=3, lead=0.0)
    out = tmp_path / "robot.yaml"
    words = ("init", "--urdf", KUKA, "--acceleration", "3", "-o", str(out), "--force", "--bag")
    write_recording(tmp_path / "torque.npz", record)
    assert "contradict" not in run(*words, str(tmp_path / "torque.npz")).err
    write_recording(tmp_path / "ampere.npz", replace(record, tau=record.tau / arm.robot.drives.torque_constant))
    told = run(*words, str(tmp_path / "ampere.npz")).err
    line = next(n for n, text in enumerate(out.read_text().splitlines(), 1) if text.startswith("effort:"))
    assert f"{out}:{line}: effort.quantity is torque, which the data contradict" in told
    some = replace(record, tau=record.tau * [0.5, 0.08, 0.09])
    write_recording(tmp_path / "some.npz", some)
    assert "'effort: current for all joints of the message" in run(*words, str(tmp_path / "some.npz")).err


@pytest.mark.parametrize(
    ("file", "axes", "edited"),
    [
        ("ur_description/urdf/ur3_joint_limited_robot.urdf", 6, 0),
        ("ur_description/urdf/ur10_joint_limited_robot.urdf", 6, 0),
        ("panda_description/urdf/panda.urdf", 7, 0),
        ("kinova_description/robots/kinova.urdf", 6, 3),
        ("z1_description/urdf/z1.urdf", 6, 0),
        ("xarm_description/urdf/xarm7.urdf", 7, 0),
        pytest.param("so_arm_description/urdf/so101.urdf", 5, 0, marks=pytest.mark.long),
        ("talos_data/robots/talos_left_arm.urdf", 6, 0),
    ],
)
def test_lines_edited_by_hand(run: Run, robots_folder: Path, tmp_path: Path, file: str, axes: int, edited: int) -> None:
    """Nothing but limits is left to fill in; the Kinova's endless joints have none for their position."""
    out = tmp_path / "robot.yaml"
    words = ("init", "--urdf", robots_folder / file, "--acceleration", 5, "--mount", "wall", "-o", out, "--json")
    data = run(*words).json
    assert len(data["moving"]) == axes
    assert len(data["missing"]) == edited
    assert all("limit" in what for what in data["missing"])
    np.testing.assert_allclose(load_robot(out).rigid.model.gravity.linear, [-9.81, 0, 0])


PLANE = "- {kind: half_space, normal: [0, 0, 1], offset: "


@pytest.mark.parametrize(
    ("words", "plane"),
    [
        ([], "floor"),
        (["--mount", "floor"], "floor"),
        (["--mount", "ceiling"], "ceiling"),
        (["--mount", "wall"], "wall"),
        (["--gravity", "0,0,9.81"], "ceiling"),
    ],
)
def test_the_mounting_plane_is_guessed(run: Run, tmp_path: Path, words: list[str], plane: str) -> None:
    out = tmp_path / "robot.yaml"
    data = run("init", "--urdf", KUKA, "--acceleration", 3, *words, "-o", out, "--json").json
    (line,) = (text for text in out.read_text().splitlines() if "half_space" in text)
    assert line.strip().startswith(f"{PLANE}0, guess: true}}  # GUESS: flange stays")
    assert f"of the {plane} that the base is mounted on" in line
    assert any("half_space" in guess for guess in data["guesses"])
    robot = load_robot(out)
    (rule,) = robot.workspace
    assert rule.frame == "flange"
    np.testing.assert_allclose(rule.margin(np.array([[0.0, 0.0, 0.3], [0.0, 0.0, -0.2]])), [0.3, -0.2])
    assert list(robot.unchecked) == data["not_checked"][:2], "one source says what isn't checked"
    assert any("surroundings other than" in what for what in data["not_checked"])


def test_no_plane_where_nobody_knows_which_way_it_lies(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "robot.yaml"
    done = run("init", "--urdf", KUKA, "--acceleration", 3, "--gravity", "0,-9.81,0", "-o", out)
    assert "missing: the floor: how the base stands on it" in done.out
    assert "not checked: surroundings (no workspace rule)" in done.out
    assert load_robot(out).workspace == ()


@pytest.mark.parametrize(
    ("file", "lowered"),
    [
        ("ur_description/urdf/ur5_joint_limited_robot.urdf", True),
        pytest.param("panda_description/urdf/panda.urdf", False, marks=pytest.mark.long),
    ],
)
def test_the_guessed_floor_leaves_room_in_the_middle(
    run: Run, robots_folder: Path, tmp_path: Path, file: str, lowered: bool
) -> None:
    out = tmp_path / "robot.yaml"
    done = run("init", "--urdf", robots_folder / file, "--acceleration", 5, "-o", out)
    assert ("write what is really there" in done.out) is lowered
    robot = load_robot(out)
    middle = 0.5 * (robot.limits.lower + robot.limits.upper)
    (rule,) = robot.workspace
    assert rule.margin(robot.rigid.frame_position(middle[None, :], rule.frame))[0] > 0.09
    designed = run("design", "--robot", out, "--starts", 1, "--time-limit", 8, "-o", tmp_path / "x.yaml", "--json")
    assert designed.code == 3
    assert designed.json["margins"]["kept"]
    assert len(designed.json["not_checked"]) == 1
    out.write_text(out.read_text().replace(", guess: true", ""))
    assert run("check", tmp_path / "x.yaml", "--robot", out, "--json").json["not_checked"] == []


def changed(tmp_path: Path, old: str, new: str) -> Path:
    """Return the KUKA's URDF with another text at the first place where one stands."""
    text = Path(KUKA).read_text()
    assert old in text
    path = tmp_path / "changed.urdf"
    path.write_text(text.replace(old, new, 1))
    return path


def test_limits_the_wrong_way_round_are_said(run: Run, tmp_path: Path) -> None:
    urdf = changed(tmp_path, 'lower="-1.6" upper="1.6"', 'lower="1.6" upper="-1.6"')
    done = run("init", "--urdf", urdf, "--acceleration", 3, "-o", tmp_path / "robot.yaml")
    assert "missing: position limits of joint_1: the URDF's lower is above its upper" in done.out
    assert "the URDF's lower = 1.6 is above its upper = -1.6" in (tmp_path / "robot.yaml").read_text()
    refused = run("design", "--robot", tmp_path / "robot.yaml", "--time-limit", 5)
    assert refused.code == 2
    assert "joint 'joint_1': its lower position limit 1.6 is not below its upper -1.6" in refused.err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('mass value="100"', 'mass value="-100"', "link 'link_2': <mass value='-100'>: a mass is never negative"),
        ('ixx="10.273"', 'ixx="-1"', "link 'link_3': <inertia ixx='-1'>: a moment of inertia is never negative"),
    ],
)
def test_negative_masses_are_named(run: Run, tmp_path: Path, old: str, new: str, said: str) -> None:
    refused = run("design", "--robot", changed(tmp_path, old, new), "--time-limit", 5)
    assert refused.code == 2
    assert said in refused.err


def test_links_without_inertia_are_said(run: Run, tmp_path: Path) -> None:
    zero = '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
    urdf = changed(tmp_path, '<inertia ixx="1.6016" ixy="0" ixz="0" iyy="1.6016" iyz="0" izz="1.6016"/>', zero)
    data = run("init", "--urdf", urdf, "--acceleration", 3, "-o", tmp_path / "robot.yaml", "--json").json
    assert data["missing"] == ["moments of inertia of what joint_1 moves: zero in the URDF"]


def test_an_arm_too_heavy_for_its_motors_is_named(run: Run, tmp_path: Path) -> None:
    urdf = changed(tmp_path, 'effort="443"', 'effort="1e-9"')
    assert run("init", "--urdf", urdf, "--acceleration", 3, "-o", tmp_path / "robot.yaml").code == 0
    refused = run("design", "--robot", tmp_path / "robot.yaml", "--time-limit", 4)
    assert refused.code == 2
    assert "joint_2 takes" in refused.err
    assert "no pose can be held" in refused.err
    assert "give it more" not in refused.err
