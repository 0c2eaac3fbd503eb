"""What the estimator keeps is what the reader of bags would give, and no more than it needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from robot_ident.bags import read_messages, read_recording, write_recording
from robot_ident.errors import InputError
from robot_ident.nodes.message_buffer import Collector, recording_of
from robot_ident.playback.stamps import header_stamp
from robot_ident.recording.recording import Recording

NAMES = ("joint_1", "joint_2")


def test_same_recording_as_from_a_bag(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.004, 0.009, 500))
    made = Recording(
        NAMES, t - t[0], rng.normal(size=(500, 2)), rng.normal(size=(500, 2)), start_ns=1_700_000_000_123_456_789
    )
    write_recording(tmp_path / "bag", made)
    collector = Collector(1000.0)
    for raw in read_messages(tmp_path / "bag"):
        collector.add(header_stamp(raw.data), raw.log_time, raw.data)
    live, read = (
        recording_of(collector.snapshot(), "joint_states", NAMES),
        read_recording(tmp_path / "bag", joints=NAMES),
    )
    for field in ("t", "q", "tau"):
        np.testing.assert_array_equal(getattr(live, field), getattr(read, field))
    assert (live.names, live.start_ns) == (read.names, read.start_ns)


def test_memory_is_bounded() -> None:
    collector = Collector(2.0)
    for k in range(5000):
        collector.add(10**18 + k * 10_000_000, 0, b"message")
    assert len(collector) == 201 and collector.received == 5000
    collector.add(10**9, 0, b"a clock that jumped")
    assert len(collector) == 1


def test_nothing_received() -> None:
    with pytest.raises(InputError, match="nothing has been received"):
        recording_of([], "joint_states", NAMES)
