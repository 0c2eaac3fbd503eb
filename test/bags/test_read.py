"""What the user asks of a recording: the right topic, joints by name, one clock, and one line when it can't be."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robot_ident.bags import read_recording
from robot_ident.errors import InputError

JOINT_STATE = "sensor_msgs/msg/JointState"


def one_line(path: Path, **options: object) -> str:
    with pytest.raises(InputError) as caught:
        read_recording(path, **options)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)
    return str(caught.value)


# -- topics


def test_command_topic_is_no_state(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(50)
    messages = maker.messages_of(recording)
    commands = [("/joint_command", JOINT_STATE, "cdr", messages)]
    maker.assert_same(read_recording(maker.write_mcap(tmp_path / "a.mcap", messages, others=commands)), recording)
    only = maker.write_mcap(tmp_path / "b.mcap", [], others=commands)
    assert "/joint_command sensor_msgs/msg/JointState (50)" in one_line(only)
    assert read_recording(only, topic="joint_command").samples == 50


@pytest.mark.parametrize("asked", [None, "joint_states", "/arm/joint_states", "arm/joint_states"])
def test_namespaced_topic(tmp_path: Path, maker: SimpleNamespace, asked: str | None) -> None:
    recording = maker.make_recording(50)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), topic="/arm/joint_states")
    maker.assert_same(read_recording(path, topic=asked), recording)


def test_joint_states_goes_before_residuals(tmp_path: Path, maker: SimpleNamespace) -> None:
    """The estimator publishes JointStates with efforts too; they are not the robot's."""
    recording = maker.make_recording(50)
    others = [("/estimator/predicted", JOINT_STATE, "cdr", maker.messages_of(maker.make_recording(70, seed=1)))]
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), others=others)
    maker.assert_same(read_recording(path), recording)


def test_the_one_with_efforts_is_taken(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(50)
    bare = [(log, maker.serialise(("x",), log, (1,))) for log, _ in maker.messages_of(recording)]
    others = [("/gripper/joint_states", JOINT_STATE, "cdr", bare)]
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), topic="/arm/joint_states", others=others)
    maker.assert_same(read_recording(path), recording)


def test_several_fit(tmp_path: Path, maker: SimpleNamespace) -> None:
    messages = maker.messages_of(maker.make_recording(50))
    others = [("/right/joint_states", JOINT_STATE, "cdr", messages)]
    path = maker.write_mcap(tmp_path / "a.mcap", messages, topic="/left/joint_states", others=others)
    for options in ({}, {"topic": "joint_states"}):
        line = one_line(path, **options)
        assert "/left/joint_states" in line
        assert "/right/joint_states" in line
    assert read_recording(path, topic="/left/joint_states").samples == 50


def test_other_topic_only(tmp_path: Path, maker: SimpleNamespace) -> None:
    others = [("/chatter", "std_msgs/msg/String", "cdr", [(5, b"\0\1\0\0\2\0\0\0a\0")] * 3)]
    path = maker.write_mcap(tmp_path / "a.mcap", [], others=others)
    assert "topics: /chatter std_msgs/msg/String (3)" in one_line(path)
    line = one_line(path, topic="/chatter")
    assert "'/chatter' is no sensor_msgs/msg/JointState" in line
    assert "'/states' is not in it" in one_line(path, topic="/states")


def test_empty_bag(tmp_path: Path, maker: SimpleNamespace) -> None:
    assert "the bag is empty" in one_line(maker.write_mcap(tmp_path / "a.mcap", []))
    assert "the bag is empty" in one_line(maker.write_rosbag2(tmp_path / "bag", [], "SQLITE3"))
    assert "has no messages" in one_line(tmp_path / "a.mcap", topic="joint_states")


def test_other_encoding(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(
            "/joint_states", "json", writer.register_schema(JOINT_STATE, "jsonschema", b"")
        )
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    assert "[json] (1)" in one_line(path)


# -- joints and fields


def test_joints_by_name(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(50, 4)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording))
    names = recording.names[::-1][:3]
    got = read_recording(path, joints=names)
    expected = recording.with_joints(names)
    assert got.names == names
    np.testing.assert_array_equal(got.q, expected.q)
    np.testing.assert_array_equal(got.tau, expected.tau)
    line = one_line(path, joints=["oint_1", "oint_9"])
    assert "joint 'oint_9' is missing" in line
    assert "the recording has oint_1, joint_2" in line


def test_joints_that_never_meet(tmp_path: Path, maker: SimpleNamespace) -> None:
    messages = [(k, maker.serialise((name,), k, (1,), (), (2,))) for k, name in enumerate(["a", "b"] * 5, start=1)]
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    assert "never come in one message" in one_line(path, joints=["a", "b"])
    assert read_recording(path, joints=["b"]).samples == 5


def test_no_efforts(tmp_path: Path, maker: SimpleNamespace) -> None:
    messages = [(k, maker.serialise(("a",), k, (1,))) for k in range(1, 9)]
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    assert "reports no efforts in any of its 8 messages" in one_line(path)


@pytest.mark.parametrize("field", ["position", "velocity", "effort"])
def test_wrong_length(tmp_path: Path, maker: SimpleNamespace, field: str) -> None:
    good = maker.serialise(("a", "b"), 1, (1, 2), (1, 2), (1, 2))
    values = {name: (1, 2, 3) if name == field else (1, 2) for name in ("position", "velocity", "effort")}
    messages = [(1, good), (2, maker.serialise(("a", "b"), 2, *values.values())), (3, good)]
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    assert f"message 2: {field} has 3 values for 2 joints (a, b)" in one_line(path)


@pytest.mark.parametrize("field", ["q", "tau", "dq"])
def test_nan(tmp_path: Path, maker: SimpleNamespace, field: str) -> None:
    recording = maker.make_recording(50)
    values = {name: np.array(getattr(recording, name)) for name in ("q", "dq", "tau")}
    values[field][30:33, 1] = np.nan
    messages = [
        (stamp, maker.serialise(recording.names, stamp, *(v[k] for v in values.values())))
        for k, stamp in enumerate(maker.stamps_of(recording))
    ]
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    assert f"{field} is not a number in 3 of 50 samples, first at t = 0.200 s" in one_line(path)


def test_joint_without_sensor(tmp_path: Path, maker: SimpleNamespace) -> None:
    """ros2_control reports NaN where there is no interface: that joint, or the velocities, are left out."""
    stamps = range(1, 6)
    nan = float("nan")
    messages = [(s, maker.serialise(("a", "b"), s, (s, s), (nan, nan), (s, nan))) for s in stamps]
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    got = read_recording(path)
    assert got.names == ("a",)
    assert got.dq is None
    assert "the effort of b is never a number; left out" in got.notes
    with pytest.raises(
        InputError, match="joint 'b' is missing; the recording has a; the effort of b is never a number"
    ):
        got.with_joints(("a", "b"))
    assert "the effort of joint 'b' is not a number in any" in one_line(path, joints=["a", "b"])


# -- time


def restamped(maker: SimpleNamespace, stamps: list[int], logs: list[int] | None = None) -> list[tuple[int, bytes]]:
    """Return messages whose position is their number, with these stamps and receive times."""
    logs = [maker.start + 10**6 * k for k in range(len(stamps))] if logs is None else logs
    return [
        (log, maker.serialise(("a",), stamp, (k,), (), (-k,)))
        for k, (stamp, log) in enumerate(zip(stamps, logs, strict=True))
    ]


def test_zero_stamps(tmp_path: Path, maker: SimpleNamespace) -> None:
    logs = [maker.start + 7_000_000 * k for k in range(20)]
    got = read_recording(maker.write_mcap(tmp_path / "a.mcap", restamped(maker, [0] * 20, logs)))
    np.testing.assert_array_equal(got.t, np.arange(20) * 7_000_000 / 1e9)
    assert got.start_ns == maker.start
    assert got.notes == ("no message has a header stamp: the receive time is used",)


def test_some_zero_stamps(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Simulated time starts near zero while the receive time is the wall clock: they must not be mixed."""
    stamps = [5_000_000_000 + 1_000_000 * k for k in range(20)]
    stamps[7] = 0
    got = read_recording(maker.write_mcap(tmp_path / "a.mcap", restamped(maker, stamps)))
    np.testing.assert_array_equal(got.t, np.arange(20) * 1_000_000 / 1e9)
    assert "1 of 20 messages have no header stamp" in got.notes[0]


def test_nanoseconds_survive(tmp_path: Path, maker: SimpleNamespace) -> None:
    stamps = [maker.start + k * 3_600_000_000_000 + k for k in range(100)]  # four days, 1 ns apart from round
    got = read_recording(maker.write_mcap(tmp_path / "a.mcap", restamped(maker, stamps)))
    assert [round(t * 1e9) for t in got.t] == [stamp - stamps[0] for stamp in stamps]


def test_out_of_order_and_duplicates(tmp_path: Path, maker: SimpleNamespace) -> None:
    stamps = [maker.start + 10**6 * k for k in range(30)]
    messages = restamped(maker, stamps)
    messages[10], messages[12] = messages[12], messages[10]
    messages.insert(20, messages[19])
    messages.insert(25, (messages[25][0], maker.serialise(("a",), stamps[23], (99,), (), (99,))))
    got = read_recording(maker.write_mcap(tmp_path / "a.mcap", messages))
    np.testing.assert_array_equal(got.q[:, 0], np.arange(30))
    np.testing.assert_array_equal(got.t, np.arange(30) * 10**6 / 1e9)
    assert got.notes == (
        "2 of 32 samples came later than their stamps say and were sorted",
        "1 samples came again with the same stamp and content; dropped",
        "1 samples have the stamp of another with different content; the first one is kept",
    )


# -- files


@pytest.mark.parametrize("apart", [0, 10_000])
def test_bursts_are_spread(tmp_path: Path, maker: SimpleNamespace, apart: int) -> None:
    """Five samples at a time, stamped when the burst arrived: all are kept, and their times are right again."""
    times = [maker.start + 10**7 * k for k in range(1, 201)]
    stamps = [times[k - k % 5 + 4] + apart * (k % 5) for k in range(200)]
    got = read_recording(maker.write_mcap(tmp_path / "bursts.mcap", restamped(maker, stamps)))
    assert got.samples == 200
    np.testing.assert_allclose(np.diff(got.t), 0.01, atol=2e-8)
    assert any("160 samples came in bursts" in note for note in got.notes)


def test_bursts_decades_apart_overflow_nothing(tmp_path: Path, maker: SimpleNamespace) -> None:
    """As damaged stamps may say: an answer or one line, and no wrapped number."""
    stamps = [10**18 * (k // 13) + 1000 * (k % 13) for k in range(39)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            got = read_recording(maker.write_mcap(tmp_path / "a.mcap", restamped(maker, stamps)))
        except InputError as error:
            assert "a.mcap" in str(error)
        else:
            assert np.all(np.diff(got.t) > 0)


def test_two_rates_are_no_bursts(tmp_path: Path, maker: SimpleNamespace) -> None:
    stamps = [maker.start + 10**6 * k for k in range(1, 301)]
    stamps += [stamps[-1] + 10**8 * k for k in range(1, 61)]
    got = read_recording(maker.write_mcap(tmp_path / "two.mcap", restamped(maker, stamps)))
    assert got.samples == 360
    assert got.notes == ()


def test_unknown_files(tmp_path: Path) -> None:
    assert "no such file" in one_line(tmp_path / "gone.mcap")
    (tmp_path / "a.txt").write_text("hello")
    assert "is no recording; expected a rosbag2 folder, .mcap, .db3 or a table (.csv, .npz)" in one_line(
        tmp_path / "a.txt"
    )
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V2.0\n")
    assert "is a ROS 1 bag; convert it" in one_line(tmp_path / "a.bag")


def test_content_tells_where_the_suffix_does_not(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(30)
    maker.assert_same(read_recording(maker.write_mcap(tmp_path / "data", maker.messages_of(recording))), recording)


def test_reading_needs_no_ros_and_no_library_of_bags(tmp_path: Path, maker: SimpleNamespace) -> None:
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(maker.make_recording(30)))
    code = (
        "import sys; from robot_ident.bags import read_recording; read_recording(sys.argv[1]);"
        "print(*{name.split('.')[0] for name in sys.modules} & {'rclpy', 'rosbags', 'mcap', 'scipy', 'casadi'})"
    )
    command = [sys.executable, "-c", code, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert done.stdout.strip() == ""


def test_a_faster_topic_in_the_same_bag_is_named(tmp_path: Path, maker: SimpleNamespace) -> None:
    messages = maker.messages_of(maker.make_recording(200))
    others = [("/arm/measured", JOINT_STATE, "cdr", messages)]
    path = maker.write_mcap(tmp_path / "a.mcap", messages[::4], others=others)
    told = "/arm/measured reports the same joints 4 times as often (--topic /arm/measured)"
    assert told in read_recording(path).notes
    assert not any("as often" in note for note in read_recording(path, topic="/arm/measured").notes)
