"""The recorder keeps every byte and both stamps, leaves a whole bag when it is killed, and says what is missing."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")

from strict_mcap import judge  # noqa: E402

from robot_ident.bags import describe, read_messages, read_recording  # noqa: E402

NAMES = ("joint_1", "joint_2", "joint_3")


def message(k: int) -> Any:
    from robot_ident.nodes.messages import joint_state

    stamp = 1_700_000_000_000_000_000 + k * 5_000_000
    return joint_state(NAMES, stamp, np.array([k, 2.0 * k, -k]), np.ones(3), np.array([0.5, k / 7, 1.0]))


def publisher(client: Any, until: Callable[..., Any], topic: str = "joint_states") -> Any:
    from sensor_msgs.msg import JointState

    made = client.create_publisher(JointState, topic, 1000)
    assert until(made.get_subscription_count), "the recorder does not listen"
    return made


def send(made: Any, numbers: range) -> None:
    for k in numbers:
        made.publish(message(k))
        time.sleep(0.002)


def settled(made: Any, bag: Path) -> None:
    """Wait until the recorder has received and written what is under way."""
    from rclpy.duration import Duration

    made.wait_for_all_acked(Duration(seconds=10))
    size = -1
    while size != (size := sum(file.stat().st_size for file in bag.glob("*.mcap"))):
        time.sleep(0.3)


def test_bag_holds_what_was_sent(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], call: Callable[..., Any], tmp_path: Path
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray
    from std_msgs.msg import Float64
    from std_srvs.srv import Trigger

    bag = tmp_path / "bag"
    statuses: list[DiagnosticArray] = []
    client.create_subscription(DiagnosticArray, "/recorder/status", statuses.append, 10)
    recorder = start("recorder", output=bag, topics="[temperature]", autostart=False, status_rate=10.0)
    other = client.create_publisher(Float64, "temperature", 10)
    made = publisher(client, until)
    assert call(Trigger, "/recorder/start").success
    assert until(other.get_subscription_count), "a topic whose type is found in the graph"
    before = time.time_ns()
    send(made, range(100, 300))
    send(made, range(305, 320))
    other.publish(Float64(data=21.5))
    assert until(lambda: statuses and any(v.value == "216" for v in statuses[-1].status[0].values)), statuses[-1]
    answer = call(Trigger, "/recorder/stop")
    assert answer.success and "216 messages" in answer.message
    assert not call(Trigger, "/recorder/stop").success
    send(made, range(400, 405))
    second = call(Trigger, "/recorder/start")
    assert not second.success and "exists already" in second.message
    assert recorder.end()[0] == 0, recorder.text

    recording = read_recording(bag)
    np.testing.assert_array_equal(recording.q[:, 0], [*range(100, 300), *range(305, 320)])
    np.testing.assert_array_equal(np.diff(np.round(recording.t * 1e9)) % 5_000_000, 0)
    assert recording.start_ns == 1_700_000_000_500_000_000
    for raw in read_messages(bag, ["/joint_states"]):
        assert before < raw.publish_time <= raw.log_time < time.time_ns()
        assert raw.topic.type_hash.startswith("RIHS01_") and "reliable" in raw.topic.qos
    text = (bag / "metadata.yaml").read_text()
    assert "215 messages at 200.0 Hz, 0 lost on the way, 1 gaps (5 samples" in " ".join(text.split())


def test_topics_come_in_the_order_of_time(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    """Whoever reads the bag: three topics at once, in several files, as rosbags and the specification have it."""
    from rclpy.serialization import deserialize_message
    from rosbags.rosbag2 import Reader

    bag = tmp_path / "bag"
    recorder = start("recorder", output=bag, split_duration=0.2, topics='["left:sensor_msgs/msg/JointState"]')
    made = [publisher(client, until, topic) for topic in ("joint_states", "joint_command")]
    made.append(client.create_publisher(type(message(0)), "left", 1000))
    assert until(made[2].get_subscription_count)
    for k in range(300):
        for one in made:
            one.publish(message(k))
        time.sleep(0.002)
    settled(made[0], bag)
    assert recorder.end()[0] == 0, recorder.text
    files = sorted(bag.glob("*.mcap"), key=lambda file: int(file.stem.rpartition("_")[2]))
    assert len(files) > 1, "the bag is split"
    strict = [one for file in files for one in judge(file, ended=True)]
    with Reader(bag) as reader:
        got = [(connection.topic, stamp, bytes(raw)) for connection, stamp, raw in reader.messages()]
    assert got == [(one.topic, one.log_time, one.data) for one in strict]
    for topic in ("/joint_states", "/joint_command", "/left"):
        ours = [raw for name, _, raw in got if name == topic]
        assert [deserialize_message(raw, type(message(0))).position[0] for raw in ours] == list(range(300))


def test_a_best_effort_publisher_is_recorded(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    """The recorder asked for reliable messages before it knew; what was offered stands in the bag."""
    import yaml
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    bag = tmp_path / "bag"
    recorder = start("recorder", output=bag)
    recorder.says("recording to")
    quick = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    made = client.create_publisher(type(message(0)), "joint_states", quick)
    assert until(made.get_subscription_count), "the recorder asks for less"
    send(made, range(200))
    time.sleep(0.3)
    assert recorder.end()[0] == 0, recorder.text
    assert read_recording(bag).samples > 190
    info = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    offered = {one["topic_metadata"]["name"]: one["topic_metadata"] for one in info["topics_with_message_count"]}
    assert offered["/joint_states"]["offered_qos_profiles"][0]["reliability"] == "best_effort"
    assert judge(bag / "bag_0.mcap", ended=True)


def test_an_interrupted_recorder_writes_what_has_come(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    """Messages that wait in its queue when the signal comes are in the bag."""
    from rclpy.duration import Duration

    bag = tmp_path / "bag"
    recorder = start("recorder", output=bag)
    made = publisher(client, until)
    for k in range(900):
        made.publish(message(k))
    assert made.wait_for_all_acked(Duration(seconds=10))
    assert recorder.end()[0] == 0, recorder.text
    assert read_recording(bag).samples == 900


def test_a_killed_recorder_leaves_what_it_had_taken(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    recorder = start("recorder", output=bag)
    made = publisher(client, until)
    send(made, range(400))
    settled(made, bag)
    assert until(lambda: next(bag.glob("*.mcap")).stat().st_size > 400 * 150)
    code, _ = recorder.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    recording = read_recording(bag)
    assert recording.samples == 400
    assert any("not closed properly" in note for note in describe(bag).notes)
    assert len(judge(bag / "bag_0.mcap", ended=False)) == 400


def test_a_full_disk_is_told_and_what_came_before_is_kept(
    start: Callable[..., Any], client: Any, until: Callable[..., Any], tmp_path: Path
) -> None:
    """A limit on the size of files stands in for the full disk: the kernel refuses the write just as well."""
    import subprocess

    bag = tmp_path / "bag"
    recorder = start("recorder", output=bag)
    made = publisher(client, until)
    send(made, range(50))
    subprocess.run(["prlimit", f"--pid={recorder.popen.pid}", f"--fsize={60_000}:{60_000}"], check=True)
    send(made, range(50, 600))
    assert recorder.wait() == 2, recorder.text
    assert "can't be written" in recorder.text.splitlines()[-1] and "Traceback" not in recorder.text
    recording = read_recording(bag)
    assert recording.samples > 100
    np.testing.assert_array_equal(recording.q[:, 0], np.arange(recording.samples))
