"""The bytes of JointState: written like rosbags writes them, read whatever the names, byte order and padding."""

from __future__ import annotations

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from robot_ident.bags.cdr import NotCdr, layout_of, serialise

NAMES = [("a",), ("ab", "abc"), ("joint_1", "gelenk_zwei", "é", ""), tuple("abcdefg")]


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("fields", ["q", "q tau", "q dq tau", ""])
def test_serialised_like_rosbags(maker: SimpleNamespace, names: tuple[str, ...], fields: str) -> None:
    random = np.random.default_rng(1)
    stamps = np.array([1, 999_999_999, 1_000_000_000, maker.start])
    values = {field: random.normal(size=(4, len(names))) for field in fields.split()}
    rows = serialise(names, stamps, values.get("q"), values.get("dq"), values.get("tau"))
    for k, stamp in enumerate(stamps.tolist()):
        expected = maker.serialise(names, stamp, **{f: v[k] for f, v in values.items()})
        assert rows[k].tobytes() == expected


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("little_endian", [True, False])
def test_layout_finds_values(maker: SimpleNamespace, names: tuple[str, ...], little_endian: bool) -> None:
    q = np.arange(1.0, len(names) + 1)
    data = maker.serialise(names, maker.start, q, (), -q, "frame", little_endian)
    layout = layout_of(data[4:], int(little_endian))
    rows = np.frombuffer(data[4:].ljust(-(-len(data[4:]) // 8) * 8, b"\0"), dtype=np.uint8)[None]
    assert layout.names == names
    assert layout.stamps(rows).tolist() == [maker.start]
    np.testing.assert_array_equal(layout.values(rows, layout.position)[0], q)
    np.testing.assert_array_equal(layout.values(rows, layout.effort)[0], -q)
    assert layout.values(rows, layout.velocity).shape == (1, 0)
    assert layout.matches(rows).all()


def test_padding_is_not_compared(maker: SimpleNamespace) -> None:
    """Some writers leave garbage between the fields; it must not make two layouts of one."""
    data = bytearray(maker.serialise(("a", "b"), maker.start, (1, 2), (), (3, 4))[4:])
    layout = layout_of(bytes(data), 1)
    at = data.index(b"a\0") + 2
    data[at : at + 2] = b"\xff\xfe"
    rows = np.frombuffer(bytes(data).ljust(-(-len(data) // 8) * 8, b"\0"), dtype=np.uint8)[None]
    assert layout.matches(rows).all()
    data[at - 2] = ord("c")
    rows = np.frombuffer(bytes(data).ljust(-(-len(data) // 8) * 8, b"\0"), dtype=np.uint8)[None]
    assert not layout.matches(rows).any()


def test_xcdr2_aligns_doubles_to_four() -> None:
    """Another DDS client may send XCDR2, where no number is aligned to more than 4 bytes."""
    body = struct.pack("<iI", 5, 6) + struct.pack("<I", 1) + b"\0" + bytes(3)
    body += struct.pack("<II", 1, 5) + b"abcd\0" + bytes(3)
    for values in ([1.5], [], [2.5]):
        body += struct.pack("<I", len(values)) + struct.pack(f"<{len(values)}d", *values)
    layout = layout_of(body, 7)
    rows = np.frombuffer(body.ljust(-(-len(body) // 8) * 8, b"\0"), dtype=np.uint8)[None]
    assert layout.position[0] % 8 == 4
    assert layout.values(rows, layout.position).tolist() == [[1.5]]
    assert layout.values(rows, layout.effort).tolist() == [[2.5]]
    assert layout.stamps(rows).tolist() == [5_000_000_006]


def test_every_truncation_is_noticed(maker: SimpleNamespace) -> None:
    body = maker.serialise(("joint_1", "b"), maker.start, (1, 2), (3, 4), (5, 6))[4:]
    for size in range(len(body)):
        with pytest.raises(NotCdr):
            layout_of(body[:size], 1)
    with pytest.raises(NotCdr, match="follow the last field"):
        layout_of(body + bytes(40), 1)
    with pytest.raises(NotCdr, match="0x0003"):
        layout_of(body, 3)


@pytest.mark.parametrize("names", [("a",), ("ab", "abc"), ("joint_1", "joint_2", "j3")])
@pytest.mark.parametrize("fields", ["q", "q tau", "q dq tau", ""])
def test_what_ros_serialises(names: tuple[str, ...], fields: str) -> None:
    """rmw_fastrtps leaves garbage in the padding, and bytes after the last field."""
    serialization = pytest.importorskip("rclpy.serialization")
    message = pytest.importorskip("sensor_msgs.msg").JointState(name=list(names))
    message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id = 3, 4, "world"
    values = [float(k) for k in range(len(names))]
    for field, attribute in (("q", "position"), ("dq", "velocity"), ("tau", "effort")):
        setattr(message, attribute, values if field in fields.split() else [])
    payloads = [bytes(serialization.serialize_message(message)) for _ in range(20)]
    rows = np.zeros((20, -(-len(payloads[0]) // 8) * 8), dtype=np.uint8)
    for row, payload in zip(rows, payloads, strict=True):
        row[: len(payload) - 4] = np.frombuffer(payload[4:], dtype=np.uint8)
    layout = layout_of(payloads[0][4:], 1)
    assert layout.names == names
    assert layout.matches(rows).all()
    assert layout.stamps(rows).tolist() == [3_000_000_004] * 20
    for field, place in (("q", layout.position), ("dq", layout.velocity), ("tau", layout.effort)):
        expected = [values] * 20 if field in fields.split() else [[]] * 20
        assert layout.values(rows, place).tolist() == expected
