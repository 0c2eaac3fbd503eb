"""Bags that we write: other libraries read them, a killed process loses nothing, a full disk costs one line."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from robot_ident.bags import (
    JOINT_STATE,
    BagWriter,
    Qos,
    Topic,
    describe,
    qos_text,
    read_messages,
    read_recording,
    write_recording,
)
from robot_ident.errors import InputError

ROOT = Path(__file__).parents[2]
STATES = Topic("/joint_states", JOINT_STATE, qos=qos_text([Qos(reliability="best_effort", depth=5)]))
COMMANDS = Topic("/joint_command", JOINT_STATE)


@pytest.fixture(params=[False, True], ids=["plain", "zstd"])
def compress(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


def write_bag(path: Path, maker: SimpleNamespace, compress: bool, samples: int = 300) -> list[tuple[int, bytes]]:
    messages = maker.messages_of(maker.make_recording(samples))
    with BagWriter(path, [STATES, COMMANDS], compress=compress) as bag:
        for k, (log, data) in enumerate(messages):
            bag.write("/joint_states", data, log, log - 1_000_000, k)
        bag.custom_data["dropped"] = "0"
    return messages


# -- others read what we write


def test_mcap_library_reads_it(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    messages = write_bag(tmp_path / "bag", maker, compress)
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        got = [(message.log_time, message.data) for _, _, message in reader.iter_messages()]
        assert got == messages
        file.seek(0)
        reader = make_reader(file)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 300
        assert summary.chunk_indexes
        schema, channel, message = next(iter(reader.iter_messages()))
        assert schema is not None
        assert (schema.name, schema.encoding) == (JOINT_STATE, "ros2msg")
        assert b"float64[] effort" in schema.data
        assert channel.message_encoding == "cdr"
        assert channel.metadata["topic_type_hash"] == maker.store.hash_rihs01(JOINT_STATE)
        assert yaml.safe_load(channel.metadata["offered_qos_profiles"])[0]["reliability"] == "best_effort"
        assert message.publish_time == messages[0][0] - 1_000_000
        (metadata,) = reader.iter_metadata()
        assert metadata.name == "rosbag2"
        assert yaml.safe_load(metadata.metadata["serialized_metadata"])["message_count"] == 300


def test_rosbags_reads_it(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    recording = maker.make_recording(300)
    write_bag(tmp_path / "bag", maker, compress)
    with AnyReader([tmp_path / "bag"]) as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        assert set(connections) == {"/joint_states", "/joint_command"}
        assert connections["/joint_states"].msgcount == 300
        for k, (connection, _, raw) in enumerate(reader.messages()):
            message = reader.deserialize(raw, connection.msgtype)
            assert tuple(message.name) == recording.names
            np.testing.assert_array_equal(message.effort, recording.tau[k])
        assert k == 299
    with Reader(tmp_path / "bag") as low:
        assert low.message_count == 300
        assert low.duration == round(recording.duration * 1e9) + 1  # rosbags counts the last nanosecond
        (profile,) = next(c for c in low.connections if c.topic == "/joint_states").ext.offered_qos_profiles
        assert (profile.depth, profile.reliability.name) == (5, "BEST_EFFORT")
        assert low.ros_distro == "jazzy"


def test_metadata_is_as_jazzy_writes_it(tmp_path: Path, maker: SimpleNamespace) -> None:
    """The keys that rosbag2_storage/yaml.hpp demands of version 9, with their types."""
    messages = write_bag(tmp_path / "bag", maker, False)
    info = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    span = messages[-1][0] - messages[0][0]
    file = {
        "path": "bag_0.mcap",
        "starting_time": {"nanoseconds_since_epoch": messages[0][0]},
        "duration": {"nanoseconds": span},
        "message_count": 300,
    }
    topics = info.pop("topics_with_message_count")
    assert info == {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": span},
        "starting_time": {"nanoseconds_since_epoch": messages[0][0]},
        "message_count": 300,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": ["bag_0.mcap"],
        "files": [file],
        "custom_data": {"dropped": "0"},
        "ros_distro": "jazzy",
    }
    forever = {"sec": 9223372036, "nsec": 854775807}
    assert [topic["message_count"] for topic in topics] == [300, 0]
    assert topics[0]["topic_metadata"] == {
        "name": "/joint_states",
        "type": JOINT_STATE,
        "serialization_format": "cdr",
        "offered_qos_profiles": [
            {
                "history": "keep_last",
                "depth": 5,
                "reliability": "best_effort",
                "durability": "volatile",
                "deadline": forever,
                "lifespan": forever,
                "liveliness": "automatic",
                "liveliness_lease_duration": forever,
                "avoid_ros_namespace_conventions": False,
            }
        ],
        "type_description_hash": "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    }


def test_empty_bag(tmp_path: Path, compress: bool) -> None:
    BagWriter(tmp_path / "bag", [STATES], compress=compress).close()
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == 0
    with pytest.raises(InputError, match="the bag is empty"):
        read_recording(tmp_path / "bag")


def test_any_type(tmp_path: Path, compress: bool) -> None:
    """Further topics of any type are recorded, with or without a known definition."""
    topics = [
        Topic("/tf", "tf2_msgs/msg/TFMessage"),
        Topic("/own", "my_msgs/msg/Own"),
        Topic("/given", "my_msgs/msg/Given", definition="int8 x"),
    ]
    with BagWriter(tmp_path / "bag", topics, compress=compress) as bag:
        for k, topic in enumerate(topics):
            bag.write(topic.name, b"\0\1\0\0" + bytes([k]), 10 + k)
    got = list(read_messages(tmp_path / "bag"))
    assert [(message.topic.name, message.topic.type, message.data[4]) for message in got] == [
        (topic.name, topic.type, k) for k, topic in enumerate(topics)
    ]
    assert "geometry_msgs/TransformStamped" in got[0].topic.definition
    assert got[0].topic.type_hash.startswith("RIHS01_")
    assert got[2].topic.definition == "int8 x"


def test_round_trip(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    write_bag(tmp_path / "bag", maker, compress)
    got = read_recording(tmp_path / "bag")
    maker.assert_same(got, maker.make_recording(300))
    assert got.notes == ()


def test_split(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    recording = maker.make_recording(300)
    messages = maker.messages_of(recording)
    with BagWriter(tmp_path / "bag", [STATES], compress=compress) as bag:
        for k, (log, data) in enumerate(messages):
            if k in (100, 150):
                bag.split()
            bag.write("/joint_states", data, log)
        assert bag.messages == 300
    assert bag.messages == 300
    got = read_recording(tmp_path / "bag")
    maker.assert_same(got, recording)
    assert got.notes == ()
    with AnyReader([tmp_path / "bag"]) as reader:
        assert [raw for _, _, raw in reader.messages()] == [data for _, data in messages]


def test_several_threads(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    data = maker.messages_of(maker.make_recording(1))[0][1]
    with BagWriter(tmp_path / "bag", [STATES, COMMANDS], compress=compress) as bag:

        def write(topic: str) -> None:
            for k in range(500):
                bag.write(topic, data, k + 1)
                if k % 50 == 0:
                    bag.sync()

        threads = [threading.Thread(target=write, args=(topic.name,)) for topic in (STATES, COMMANDS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert [topic.messages for topic in describe(tmp_path / "bag").topics] == [500, 500]


# -- what can go wrong


def test_what_was_flushed_is_on_file(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    recording = maker.make_recording(20)
    bag = BagWriter(tmp_path / "bag", [STATES], compress=compress)
    for k, (log, data) in enumerate(maker.messages_of(recording)):
        bag.write("/joint_states", data, log)
        bag.flush()
        got = read_recording(tmp_path / "bag")
        maker.assert_same(got, recording, slice(0, k + 1))
        assert any("truncated" in note for note in got.notes)
    bag.close()
    assert read_recording(tmp_path / "bag").notes == ()


def test_an_open_bag_is_read_by_others(tmp_path: Path, maker: SimpleNamespace, compress: bool) -> None:
    """Whoever dies leaves what was synced, for everybody; our own reader says that it wasn't closed."""
    messages = maker.messages_of(maker.make_recording(300))
    bag = BagWriter(tmp_path / "bag", [STATES, COMMANDS], compress=compress)
    for k, (log, data) in enumerate(messages):
        bag.write(("/joint_states", "/joint_command")[k % 2], data, log)
        if k % 100 == 70:
            bag.sync()
    with Reader(tmp_path / "bag") as reader:
        assert [bytes(raw) for _, _, raw in reader.messages()] == [data for _, data in messages[:271]]
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        got = [message.data for _, _, message in make_reader(file, validate_crcs=True).iter_messages()]
        assert got == [data for _, data in messages[:271]]
    notes = describe(tmp_path / "bag").notes
    assert any("the recorder was not closed properly" in note for note in notes)
    bag.close()
    bag.sync()  # of a thread that was late
    assert describe(tmp_path / "bag").notes == ()


KILLED = """
import os, sys
from robot_ident.bags import BagWriter, Topic, JOINT_STATE
bag = BagWriter(sys.argv[1], [Topic("/joint_states", JOINT_STATE)])
data = bytes.fromhex(sys.argv[2])
k = 0
while True:
    k += 1
    bag.write("/joint_states", data[:4] + k.to_bytes(4, "little") + data[8:], k)
    bag.flush()
    os.write(1, b"%d\\n" % k)
"""


def test_kill_9_loses_nothing_flushed(tmp_path: Path, maker: SimpleNamespace) -> None:
    data = maker.serialise(("a", "b"), 0, (1, 2), (), (3, 4))
    command = [sys.executable, "-c", KILLED, str(tmp_path / "bag"), data.hex()]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as process:
        assert process.stdout is not None
        for _ in range(500):
            process.stdout.readline()
        process.send_signal(signal.SIGKILL)
        rest = process.stdout.read().split()
    acknowledged = int(rest[-1]) if rest else 500
    got = read_recording(tmp_path / "bag")
    assert got.samples >= acknowledged
    np.testing.assert_array_equal(got.t, np.arange(got.samples))
    assert "the recorder was not closed properly" in " ".join(got.notes)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Mount a disk of 256 kB, where that is permitted."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        pytest.skip("no mount command")
    if mounted.returncode:
        pytest.skip(f"a tmpfs can't be mounted here: {mounted.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


def test_full_disk(small_disk: Path, maker: SimpleNamespace) -> None:
    """One line at the message that did not fit, the same line at every later one; all before it stays readable."""
    recording = maker.make_recording(6000)
    bag = BagWriter(small_disk / "bag", [STATES])
    written = 0
    with pytest.raises(
        InputError, match=r"bag: can't be written \(No space left on device\); at least (\d+) of its messages are kept$"
    ) as caught:
        for log, data in maker.messages_of(recording):
            bag.write("/joint_states", data, log)
            written += 1
            if written % 100 == 0:
                bag.flush()
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="can't be written"):
        bag.write("/joint_states", b"", 1)
    bag.close()
    got = read_recording(small_disk / "bag")
    assert written > 500
    promised = int(str(caught.value).split(" at least ")[1].split()[0])
    assert written - 100 <= promised <= got.samples
    maker.assert_same(got, recording, slice(0, got.samples))


def test_full_disk_leaves_no_half_recording(small_disk: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(5000, 7)
    for name in ("bag", "bag.mcap", "bag.npz", "bag.csv"):
        with pytest.raises(InputError, match=rf"{small_disk}/{name}: can't be written"):
            write_recording(small_disk / name, recording, start_ns=1)
        assert list(small_disk.iterdir()) == []


def test_a_disk_without_room_for_a_first_byte(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: BagWriter) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(BagWriter, "_next_file", refuse)
    with pytest.raises(InputError, match="bag: can't be written .No space left"):
        BagWriter(tmp_path / "bag", [STATES])


def test_existing_bag(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = tmp_path / "bag"
    write_bag(bag, maker, False)
    with pytest.raises(InputError, match="exists already"):
        BagWriter(bag)
    with BagWriter(bag, [STATES], force=True) as writer:
        writer.write("/joint_states", maker.messages_of(maker.make_recording(1))[0][1], 1)
    assert read_recording(bag).samples == 1
    (bag / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is replaced only if it is a rosbag2 folder and nothing else"):
        BagWriter(bag, force=True)
    assert read_recording(bag).samples == 1


def test_folder_that_can_not_be_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the folder .* does not exist"):
        BagWriter(tmp_path / "a" / "b")
    if os.geteuid():
        tmp_path.chmod(0o500)
        with pytest.raises(InputError, match="can't be written"):
            BagWriter(tmp_path / "b")


# -- a recording at once


@pytest.mark.parametrize("name", ["bag", "bag.mcap", "bag.npz", "bag.csv"])
@pytest.mark.parametrize("joints", [1, 3, 7])
@pytest.mark.parametrize("velocity", [True, False])
def test_write_recording(tmp_path: Path, maker: SimpleNamespace, name: str, joints: int, velocity: bool) -> None:
    recording = maker.make_recording(400, joints, velocity=velocity)
    path = tmp_path / name
    write_recording(path, recording, start_ns=maker.start)
    got = read_recording(path)
    assert got.notes == ()
    np.testing.assert_array_equal(got.q, recording.q)
    np.testing.assert_array_equal(got.tau, recording.tau)
    assert (got.dq is None) is not velocity
    if velocity:
        np.testing.assert_array_equal(got.dq, recording.dq)
    np.testing.assert_allclose(got.t, recording.t, rtol=0, atol=0.5e-9)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    with pytest.raises(InputError, match="exists already"):
        write_recording(path, recording)
    write_recording(path, recording[:5], force=True)
    assert read_recording(path).samples == 5


def test_written_recording_in_rosbags(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(100, 3)
    write_recording(tmp_path / "bag", recording, start_ns=maker.start, topic="/arm/joint_states")
    with AnyReader([tmp_path / "bag"]) as reader:
        raws = [(connection.topic, time, bytes(raw)) for connection, time, raw in reader.messages()]
    expected = [data for _, data in maker.messages_of(recording)]
    assert raws == [
        ("/arm/joint_states", stamp, data) for stamp, data in zip(maker.stamps_of(recording), expected, strict=True)
    ]


def test_stamps_are_never_zero(tmp_path: Path, maker: SimpleNamespace) -> None:
    """A header stamp of zero means that there is none."""
    write_recording(tmp_path / "bag", maker.make_recording(10))
    got = read_recording(tmp_path / "bag")
    assert got.start_ns > maker.start
    assert got.notes == ()
