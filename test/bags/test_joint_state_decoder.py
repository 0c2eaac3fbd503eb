"""Many messages at once give what one by one gives, whatever changes in mid-bag."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest

from robot_ident.bags import joint_states, read_recording
from robot_ident.bags.joint_states import JointStateDecoder
from robot_ident.bags.mcap_file import McapFile
from robot_ident.recording.recording import Recording


def both_ways(path: Path, **options: object) -> Recording:
    fast = read_recording(path, **options)
    with patch.object(joint_states, "_MOST_LAYOUTS", 0):
        slow = read_recording(path, **options)
    assert fast.names == slow.names
    assert fast.notes == slow.notes
    for field in ("t", "q", "tau", "dq"):
        np.testing.assert_array_equal(getattr(fast, field), getattr(slow, field))
    return fast


@pytest.mark.parametrize("joints", [1, 2, 3, 6, 7])
@pytest.mark.parametrize("velocity", [True, False])
@pytest.mark.parametrize("little_endian", [True, False])
def test_plain(tmp_path: Path, maker: SimpleNamespace, joints: int, velocity: bool, little_endian: bool) -> None:
    recording = maker.make_recording(60, joints, velocity=velocity)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording, little_endian=little_endian))
    maker.assert_same(both_ways(path), recording)


def shuffled(maker: SimpleNamespace, recording: Recording, k: int) -> bytes:
    """Return sample k with its joints in an order that changes every 50 samples."""
    order = np.random.default_rng(k // 50).permutation(len(recording.names))
    names = [recording.names[j] for j in order]
    rows = (recording.q[k, order], recording.dq[k, order], recording.tau[k, order])
    return maker.serialise(names, maker.stamps_of(recording)[k], *rows)


def test_order_of_joints_changes(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(300, 5)
    log = maker.stamps_of(recording)
    path = maker.write_mcap(tmp_path / "a.mcap", [(log[k], shuffled(maker, recording, k)) for k in range(300)])
    maker.assert_same(both_ways(path, joints=recording.names), recording)


def test_two_publishers_with_different_joints(tmp_path: Path, maker: SimpleNamespace) -> None:
    """An arm and its gripper share the topic: the arm's samples are taken, the gripper's counted."""
    arm = maker.make_recording(200, 6)
    messages = maker.messages_of(arm)
    gripper = [(log + 10, maker.serialise(("finger",), log, (1,), (2,), (3,))) for log, _ in messages[::4]]
    path = maker.write_mcap(tmp_path / "a.mcap", sorted(messages + gripper))
    got = both_ways(path)
    maker.assert_same(got, arm)
    assert got.notes == ("50 of 250 messages of other joints (finger) are left out",)
    assert both_ways(path, joints=["finger"]).samples == 50


def test_extra_joints_in_some_messages(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(90, 3)
    messages = maker.messages_of(recording)
    for k in range(30, 60):
        values = [np.append(column[k], 9.0) for column in (recording.q, recording.dq, recording.tau)]
        messages[k] = (messages[k][0], maker.serialise((*recording.names, "x"), maker.stamps_of(recording)[k], *values))
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    maker.assert_same(both_ways(path), recording)


def test_velocity_and_effort_come_and_go(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(90, 3)
    stamps = maker.stamps_of(recording)
    messages = maker.messages_of(recording)
    for k in (10, 11, 50):
        messages[k] = (stamps[k], maker.serialise(recording.names, stamps[k], recording.q[k], (), recording.tau[k]))
    for k in (20, 70):
        messages[k] = (stamps[k], maker.serialise(recording.names, stamps[k], recording.q[k], recording.dq[k]))
    got = both_ways(maker.write_mcap(tmp_path / "a.mcap", messages))
    assert got.samples == 88
    assert got.dq is None
    assert "2 of 90 messages without positions or efforts are left out" in got.notes
    assert "velocity is missing in 3 of 88 messages and is not used" in got.notes


def test_frame_id_that_counts(tmp_path: Path, maker: SimpleNamespace) -> None:
    """More layouts than are remembered: the rest is read one by one and nothing is lost."""
    recording = maker.make_recording(300, 3)
    rows = zip(maker.stamps_of(recording), recording.q, recording.dq, recording.tau, strict=True)
    messages = [
        (stamp, maker.serialise(recording.names, stamp, *row, frame_id=f"{k:04}"))
        for k, (stamp, *row) in enumerate(rows)
    ]
    maker.assert_same(both_ways(maker.write_mcap(tmp_path / "a.mcap", messages)), recording)


def test_rubbish_between_messages(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(100, 3)
    messages = maker.messages_of(recording)
    random = np.random.default_rng(0)
    size = len(messages[0][1])
    bad = [b"", b"\0", b"\0\1\0\0", bytes(size), random.bytes(size), b"\0\1\0\0" + random.bytes(size - 4)]
    messages[40:40] = [(messages[40][0], data) for data in bad]
    got = both_ways(maker.write_mcap(tmp_path / "a.mcap", messages))
    maker.assert_same(got, recording)
    assert any(note.startswith("6 messages of /joint_states are no JointState") for note in got.notes)


def test_layouts_are_found_once(tmp_path: Path, maker: SimpleNamespace) -> None:
    """The fast path is taken: thousands of messages in many chunks share one layout."""
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(maker.make_recording(20_000, 3)), chunk_size=5000)
    decoder = JointStateDecoder()
    pieces = [piece for batch in McapFile(path).batches() for piece in decoder.decode(batch)]
    assert len(pieces) > 2
    assert [len(layouts) for layouts in decoder._layouts.values()] == [1]
