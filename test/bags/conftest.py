"""Bags made by others than the code under test: messages by rosbags, files by rosbags and mcap."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.typesys import Stores, get_typestore

from robot_ident.recording.recording import Recording

JOINT_STATE = "sensor_msgs/msg/JointState"
STORE = get_typestore(Stores.ROS2_JAZZY)
START = 1_700_000_000_123_456_789


def make_recording(samples: int = 500, joints: int = 3, seed: int = 0, velocity: bool = True) -> Recording:
    """Return random values whose bits every form must carry unchanged; names of odd and even length."""
    random = np.random.default_rng(seed)
    q, tau, dq = (random.normal(size=(samples, joints)) for _ in range(3))
    names = tuple("j" * (k % 5) + f"oint_{k + 1}" for k in range(joints))
    return Recording(names, np.arange(samples) / 150, q, tau, dq if velocity else None)


def stamps_of(recording: Recording) -> list[int]:
    return [START + round(t * 1e9) for t in recording.t]


def serialise(
    names: Iterable[str],
    stamp: int,
    q: Iterable[float] = (),
    dq: Iterable[float] = (),
    tau: Iterable[float] = (),
    frame_id: str = "",
    little_endian: bool = True,
) -> bytes:
    """Return the CDR bytes of a JointState as rosbags writes them."""
    types = STORE.types
    message = types[JOINT_STATE](
        types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](stamp // 1_000_000_000, stamp % 1_000_000_000), frame_id
        ),
        list(names),
        *(np.array(list(values), dtype=float) for values in (q, dq, tau)),
    )
    return bytes(STORE.serialize_cdr(message, JOINT_STATE, little_endian=little_endian))


def messages_of(recording: Recording, **options: Any) -> list[tuple[int, bytes]]:
    """Return each sample's receive time (1 ms after its stamp) and bytes."""
    dq = np.empty((recording.samples, 0)) if recording.dq is None else recording.dq
    rows = zip(stamps_of(recording), recording.q, dq, recording.tau, strict=True)
    return [(stamp + 1_000_000, serialise(recording.names, stamp, *row, **options)) for stamp, *row in rows]


def write_mcap(
    path: Path,
    messages: Iterable[tuple[int, bytes]],
    *,
    topic: str = "/joint_states",
    compression: str | None = "zstd",
    chunk_size: int = 20_000,
    finish: bool = True,
    others: Iterable[tuple[str, str, str, list[tuple[int, bytes]]]] = (),
) -> Path:
    """Write one file by the mcap library. compression None: no chunks. others: (topic, type, encoding, messages)."""
    with path.open("wb") as file:
        kind = CompressionType[(compression or "none").upper()]
        writer = Writer(file, chunk_size, kind, use_chunking=compression is not None)
        writer.start("ros2", "test")
        entries = []
        for name, message_type, encoding, content in [*others, (topic, JOINT_STATE, "cdr", list(messages))]:
            definition = (
                STORE.generate_msgdef(message_type, ros_version=2)[0] if message_type in STORE.fielddefs else ""
            )
            schema = writer.register_schema(message_type, "ros2msg", definition.encode())
            channel = writer.register_channel(name, encoding, schema)
            entries += [(log, channel, data) for log, data in content]
        for log, channel, data in entries:
            writer.add_message(channel, log, data, max(log - 500_000, 0))
        if finish:
            writer.finish()
        else:
            writer.flush()
    return path


def write_rosbag2(path: Path, messages: Iterable[tuple[int, bytes]], plugin: str = "MCAP", **options: Any) -> Path:
    """Write a folder by rosbags' own writer; plugin MCAP or SQLITE3, mode: its compression."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Rosbag2Writer

    writer = Rosbag2Writer(path, version=9, storage_plugin=StoragePlugin[plugin])
    if "mode" in options:
        writer.set_compression(CompressionMode[options["mode"]], CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection(options.get("topic", "/joint_states"), JOINT_STATE, typestore=STORE)
        for log, data in messages:
            writer.write(connection, log, data)
    return path


def assert_same(got: Recording, expected: Recording, rows: slice = slice(None)) -> None:
    """Assert that every bit arrived, at the time it has."""
    t = (np.array(stamps_of(expected)) - START)[rows]
    assert got.names == expected.names
    np.testing.assert_array_equal(got.t, (t - t[0]) / 1e9)
    np.testing.assert_array_equal(got.q, expected.q[rows])
    np.testing.assert_array_equal(got.tau, expected.tau[rows])
    assert (got.dq is None) == (expected.dq is None)
    if got.dq is not None and expected.dq is not None:
        np.testing.assert_array_equal(got.dq, expected.dq[rows])


@pytest.fixture(scope="session")
def maker() -> SimpleNamespace:
    """The functions of this file, since test modules can't import each other."""
    functions: list[Callable[..., Any]] = [
        make_recording,
        stamps_of,
        serialise,
        messages_of,
        write_mcap,
        write_rosbag2,
        assert_same,
    ]
    return SimpleNamespace(start=START, store=STORE, **{function.__name__: function for function in functions})
