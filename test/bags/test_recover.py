"""A torn bag becomes a whole one that other libraries read, and what was lost is said."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader

from robot_ident.bags import BagWriter, Qos, Topic, describe, qos_text, read_messages, read_recording, recover
from robot_ident.errors import InputError


def torn_bag(path: Path, maker: SimpleNamespace, samples: int = 300) -> Path:
    """Return a bag whose file is torn in its last message; its topics came one after the other every 30 samples."""
    topic = Topic("/joint_states", "sensor_msgs/msg/JointState", qos=qos_text([Qos(depth=7)]))
    bag = BagWriter(path, [topic, Topic("/joint_command", topic.type)], compress=False)
    messages = maker.messages_of(maker.make_recording(samples))
    for first in range(0, samples, 30):
        for k, (log, data) in enumerate(messages[first : first + 30]):
            if k % 3 == 0:
                bag.write("/joint_command", data[:-3], log + 5, log + 1)
        for log, data in messages[first : first + 30]:
            bag.write("/joint_states", data, log, log - 3)
        bag.flush()
    file = path / f"{path.name}_0.mcap"
    content = file.read_bytes()
    file.write_bytes(content[: content.rindex(messages[-1][1]) + len(messages[-1][1]) - 7])
    return path


def test_recovered_bag_is_whole(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = torn_bag(tmp_path / "torn", maker)
    with pytest.raises(McapError):  # what other tools say to it
        make_reader((bag / "torn_0.mcap").open("rb")).get_summary()
    done = recover(bag, tmp_path / "mended")
    assert done.kept == {"/joint_states": 299, "/joint_command": 100}
    assert done.messages == 399
    assert any("its last record is cut" in line for line in done.lost)
    info = describe(tmp_path / "mended")
    assert not info.truncated
    assert info.notes == ()
    maker.assert_same(read_recording(tmp_path / "mended"), maker.make_recording(300), slice(0, 299))
    mended = list(read_messages(tmp_path / "mended"))
    there = list(read_messages(bag))
    assert mended != there, "they weren't in the order of time"
    assert mended == sorted(there, key=lambda message: message.log_time)
    with AnyReader([tmp_path / "mended"]) as reader:
        assert [raw for _, _, raw in reader.messages()] == [message.data for message in mended]
        assert [c.ext.offered_qos_profiles[0].depth for c in reader.connections if c.topic == "/joint_states"] == [7]


@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("mode", ["NONE", "FILE", "MESSAGE"])
def test_any_form(tmp_path: Path, maker: SimpleNamespace, plugin: str, mode: str) -> None:
    """SQLite and compressed bags come out as plain MCAP, with nothing lost."""
    recording = maker.make_recording(100)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording), plugin, mode=mode)
    done = recover(bag, tmp_path / "out")
    assert done.lost == ()
    maker.assert_same(read_recording(tmp_path / "out"), recording)
    with AnyReader([tmp_path / "out"]) as reader:
        assert reader.message_count == 100


def test_numbers_of_old_qos_become_words(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Bags before version 9 write QoS as numbers, which version 9 must not contain."""
    old = "- history: 1\n  depth: 10\n  reliability: 2\n  durability: 9"
    with BagWriter(tmp_path / "bag", [Topic("/x", "std_msgs/msg/String", qos=old)]) as bag:
        bag.write("/x", b"\0\1\0\0\1\0\0\0\0", 1)
    text = (tmp_path / "bag" / "metadata.yaml").read_text()
    assert "history: keep_last" in text
    assert "reliability: best_effort" in text
    assert "durability: unknown" in text


def test_nothing_to_recover(tmp_path: Path, maker: SimpleNamespace) -> None:
    (tmp_path / "a.csv").write_text("t,q_a,tau_a\n0,1,2\n")
    with pytest.raises(InputError, match="is a table"):
        recover(tmp_path / "a.csv", tmp_path / "out")
    empty = maker.write_mcap(tmp_path / "a.mcap", [])
    with pytest.raises(InputError, match="no message can be read"):
        recover(empty, tmp_path / "out")
    assert not (tmp_path / "out").exists()
    bag = torn_bag(tmp_path / "torn", maker, 10)
    with pytest.raises(InputError, match="exists already"):
        recover(bag, bag)
    with pytest.raises(InputError, match="is the bag itself"):
        recover(bag, bag, force=True)


def test_a_channel_that_was_declared_anew_keeps_its_messages(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Damage can give a channel another name in a chunk than in the summary: its messages stand under that."""
    file = tmp_path / "a.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, 2000, CompressionType.NONE, enable_crcs=False)
        writer.start("ros2", "test")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        channel = writer.register_channel("/joint_states", "cdr", schema)
        messages = maker.messages_of(maker.make_recording(60))
        for log, data in messages:
            writer.add_message(channel, log, data, log)
        writer.finish()
    file.write_bytes(file.read_bytes().replace(b"/joint_states", b"/joint_status", 1))
    kept = recover(file, tmp_path / "mended").kept
    assert sum(kept.values()) == len(messages)
    for name, count in kept.items():
        assert len([*read_messages(tmp_path / "mended", [name])]) == count
