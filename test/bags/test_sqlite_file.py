"""SQLite bags of every schema, by rosbags' writer and by hand, whole and damaged."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robot_ident.bags import describe, read_recording
from robot_ident.errors import InputError


def test_rosbags_writer(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(5000, 3)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording), "SQLITE3")
    maker.assert_same(read_recording(bag), recording)
    maker.assert_same(read_recording(bag / "bag.db3"), recording)
    assert describe(bag).form == "rosbag2 folder (SQLite)"
    assert describe(bag).topics[0].messages == 5000


def test_first_schema_of_rosbag2(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Bags of ROS 2 before Foxy have no QoS, hash or definition."""
    recording = maker.make_recording(50, 2, velocity=False)
    path = tmp_path / "old.db3"
    with sqlite3.connect(path) as connection:
        connection.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        connection.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        connection.execute("INSERT INTO topics VALUES(7, '/arm/joint_states', 'sensor_msgs/msg/JointState', 'cdr')")
        rows = [(7, log, data) for log, data in maker.messages_of(recording)]
        connection.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    connection.close()
    maker.assert_same(read_recording(path), recording)


def test_recorder_that_never_closed(tmp_path: Path, maker: SimpleNamespace) -> None:
    """What stands committed in the write-ahead log is read, and neither file is touched."""
    recording = maker.make_recording(300, 2)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording)[:100], "SQLITE3")
    connection = sqlite3.connect(bag / "bag.db3")
    connection.execute("PRAGMA journal_mode=WAL")
    rows = [(log, data) for log, data in maker.messages_of(recording)[100:]]
    connection.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", rows)
    connection.commit()
    left = tmp_path / "left"
    left.mkdir()
    for name in ("bag.db3", "bag.db3-wal"):
        (left / name).write_bytes((bag / name).read_bytes())
    connection.close()
    before = {file.name: file.read_bytes() for file in left.iterdir()}
    got = read_recording(left / "bag.db3")
    maker.assert_same(got, recording)
    assert "not closed" in got.notes[0]
    assert {file.name: file.read_bytes() for file in left.iterdir()} == before


def test_cut_anywhere(tmp_path: Path, maker: SimpleNamespace) -> None:
    """SQLite mostly refuses a file that is shorter than it should be: one line, or what it gives with the loss said."""
    recording = maker.make_recording(500, 3)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording), "SQLITE3")
    content = (bag / "bag.db3").read_bytes()
    torn = tmp_path / "torn.db3"
    for cut in [0, 10, 100, 5000, *np.random.default_rng(0).integers(0, len(content), 20).tolist()]:
        torn.write_bytes(content[:cut])
        try:
            got = read_recording(torn)
        except InputError as error:
            assert str(error).startswith(f"{torn}: ")
            assert "\n" not in str(error)
            continue
        maker.assert_same(got, recording, slice(0, got.samples))
        assert got.samples == 500 or got.notes


def test_damage_inside(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Two hundred bytes overwritten: what can be read is read and the loss said, or one line; never a wrong value."""
    recording = maker.make_recording(2000, 3)
    bag = maker.write_rosbag2(tmp_path / "bag", maker.messages_of(recording), "SQLITE3")
    content = np.frombuffer((bag / "bag.db3").read_bytes(), dtype=np.uint8)
    path = tmp_path / "damaged.db3"
    random = np.random.default_rng(0)
    partial = 0
    for _ in range(30):
        damaged = content.copy()
        at = random.integers(0, len(content) // 4096) * 4096  # the head of a page
        damaged[at : at + 200] = 0
        path.write_bytes(damaged.tobytes())
        try:
            got = read_recording(path)
            describe(path)
        except InputError as error:
            assert str(path) in str(error)
            continue
        partial += 0 < got.samples < 2000
        assert got.samples == 2000 or got.notes
        assert set(map(tuple, got.tau)) <= set(map(tuple, recording.tau))
    assert partial


def test_other_databases(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE customers(id INTEGER)")
    connection.close()
    with pytest.raises(InputError, match="no bag .*customers"):
        read_recording(path)
    path.write_bytes(b"SQLite format 3\0" + bytes(200))
    with pytest.raises(InputError, match=r"a\.db3: "):
        read_recording(path)
