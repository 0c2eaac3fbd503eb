"""Folders of rosbag2: one file or several, compressed or not, whatever state `metadata.yaml` is in."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from robot_ident.bags import describe, read_messages, read_recording
from robot_ident.errors import InputError


@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
@pytest.mark.parametrize("mode", ["NONE", "FILE", "MESSAGE"])
def test_rosbags_writer(tmp_path: Path, maker: SimpleNamespace, plugin: str, mode: str) -> None:
    recording = maker.make_recording(300, 3)
    messages = maker.messages_of(recording)
    bag = maker.write_rosbag2(tmp_path / "bag", messages, plugin, mode=mode)
    got = read_recording(bag)
    maker.assert_same(got, recording)
    assert got.notes == ()
    assert describe(bag).topics[0].joints == recording.names
    assert [(message.log_time, message.data) for message in read_messages(bag)] == messages
    if mode == "FILE":
        (packed,) = bag.glob("*.zstd")
        maker.assert_same(read_recording(packed), recording)


def split_bag(path: Path, maker: SimpleNamespace, parts: int = 12) -> Path:
    messages = maker.messages_of(maker.make_recording(240, 3))
    path.mkdir()
    size = len(messages) // parts
    for k in range(parts):
        maker.write_mcap(path / f"bag_{k}.mcap", messages[k * size : (k + 1) * size])
    names = [f"bag_{k}.mcap" for k in range(parts)]
    write_metadata(path, {"version": 9, "relative_file_paths": names, "message_count": 240})
    return path


def write_metadata(path: Path, content: object) -> None:
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}))


def test_several_files(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = split_bag(tmp_path / "bag", maker)
    got = read_recording(bag)
    maker.assert_same(got, maker.make_recording(240, 3))
    assert got.notes == ()
    assert [(topic.name, topic.messages) for topic in describe(bag).topics] == [("/joint_states", 240)]


def test_stale_metadata(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = split_bag(tmp_path / "bag", maker)
    write_metadata(bag, {"relative_file_paths": ["bag_0.mcap", "gone.mcap"], "message_count": 20})
    got = read_recording(bag)
    maker.assert_same(got, maker.make_recording(240, 3))
    assert any("gone.mcap is named in metadata.yaml but missing" in note for note in got.notes)
    assert any("announces 20 messages, the files hold 240" in note for note in got.notes)


@pytest.mark.parametrize("text", ["", "{", "a: [", "rosbag2_bagfile_information: 3", "\0", "- 1", "a: &a [*a]"])
def test_unreadable_metadata(tmp_path: Path, maker: SimpleNamespace, text: str) -> None:
    bag = split_bag(tmp_path / "bag", maker, 2)
    (bag / "metadata.yaml").write_text(text)
    maker.assert_same(read_recording(bag), maker.make_recording(240, 3))


def test_missing_metadata(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = split_bag(tmp_path / "bag", maker, 2)
    (bag / "metadata.yaml").unlink()
    got = read_recording(bag)
    maker.assert_same(got, maker.make_recording(240, 3))
    assert "no metadata.yaml" in got.notes[0]


def test_one_file_of_several_is_lost(tmp_path: Path, maker: SimpleNamespace) -> None:
    bag = split_bag(tmp_path / "bag", maker, 3)
    (bag / "bag_2.mcap").write_bytes(b"")
    got = read_recording(bag)
    maker.assert_same(got, maker.make_recording(240, 3), slice(0, 160))
    assert any("bag_2.mcap: the file is empty" in note for note in got.notes)


def test_torn_compressed_file(tmp_path: Path, maker: SimpleNamespace) -> None:
    """A compressed file of 200 kB blocks gives those that are whole."""
    recording = maker.make_recording(4000, 7)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording), mode="FILE")
    (packed,) = bag.glob("*.zstd")
    packed.write_bytes(packed.read_bytes()[: packed.stat().st_size // 2])
    got = read_recording(bag)
    assert 1000 < got.samples < 4000
    maker.assert_same(got, recording, slice(0, got.samples))
    assert describe(bag).truncated


def test_no_bag(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"is no bag; the folder holds no \.mcap or \.db3 file"):
        read_recording(tmp_path)
