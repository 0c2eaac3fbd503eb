"""Small files that claim to be large: refused, or read as far as a recording can go; no gigabyte, no minutes."""

from __future__ import annotations

import io
import sqlite3
import struct
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robot_ident.bags import JOINT_STATE, read_messages, read_recording
from robot_ident.bags.cdr import serialise

MEGABYTE = 1 << 20
MAGIC = b"\x89MCAP0\r\n"


def text(content: str) -> bytes:
    return struct.pack("<I", len(content)) + content.encode()


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def channel(number: int, name: str) -> bytes:
    return record(4, struct.pack("<HH", number, 1) + text(name) + text("cdr") + struct.pack("<I", 0))


def message(data: bytes, number: int = 0) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, 1, 1) + data)


def chunk(content: bytes) -> bytes:
    import zstandard

    packed = zstandard.ZstdCompressor(level=3).compress(content)
    head = struct.pack("<QQQI", 1, 1, len(content), 0) + text("zstd") + struct.pack("<Q", len(packed))
    return record(6, head + packed)


HEAD = MAGIC + record(1, text("ros2") + text("")) + record(3, struct.pack("<H", 1) + text(JOINT_STATE) + text("") * 2)
STATE = serialise(("a",), np.array([1_000_000_000]), np.ones((1, 1)), None, np.ones((1, 1)))[0].tobytes()


def test_chunks_of_one_message_over_and_over(reader: Any, tmp_path: Path) -> None:
    """Half a gigabyte of equal messages from half a megabyte, in chunks that are each of a usual size."""
    packed = chunk(message(STATE) * (8 * MEGABYTE // len(message(STATE))))
    assert len(packed) < MEGABYTE / 60
    (tmp_path / "a.mcap").write_bytes(HEAD + channel(0, "/joint_states") + packed * 64)
    reader.read("large", tmp_path / "a.mcap")


def test_a_chunk_that_claims_everything(reader: Any, tmp_path: Path) -> None:
    head = struct.pack("<QQQI", 1, 1, 1 << 62, 0) + text("zstd") + struct.pack("<Q", 4) + b"\0" * 4
    (tmp_path / "a.mcap").write_bytes(HEAD + channel(0, "/a") + record(6, head))
    assert "4611686018427387904 bytes" in reader.read("large", tmp_path / "a.mcap")


def test_messages_that_unfold_one_by_one(reader: Any, tmp_path: Path) -> None:
    import zstandard

    packed = zstandard.ZstdCompressor().compress(bytes(64 * MEGABYTE))
    (tmp_path / "a.mcap").write_bytes(HEAD + channel(0, "/joint_states") + message(packed) * 100)
    reader.read("large", tmp_path / "a.mcap")


def test_a_file_that_unfolds(reader: Any, tmp_path: Path) -> None:
    import zstandard

    content = HEAD + channel(0, "/joint_states") + message(STATE)
    packer = zstandard.ZstdCompressor().compressobj()
    packed = [packer.compress(content)]
    packed += [packer.compress(bytes(16 * MEGABYTE)) for _ in range(100)]
    (tmp_path / "a.mcap.zstd").write_bytes(b"".join([*packed, packer.flush()]))
    reader.read("large", tmp_path / "a.mcap.zstd")
    assert len(list(read_messages(tmp_path / "a.mcap.zstd"))) == 1


@pytest.mark.long
def test_as_many_channels_as_there_can_be(reader: Any, tmp_path: Path) -> None:
    records = b"".join(channel(number, f"/joint_{number}") + message(STATE, number) for number in range(20_000))
    (tmp_path / "a.mcap").write_bytes(HEAD + records)
    assert "several topics" in reader.read("large", tmp_path / "a.mcap")


def test_an_archive_that_unfolds(reader: Any, tmp_path: Path) -> None:
    array = io.BytesIO()
    np.save(array, np.zeros(64 * MEGABYTE // 8))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("t", "q", "tau"):
            archive.writestr(f"{name}.npy", array.getvalue())
    assert "more than any recording" in reader.read("table", tmp_path / "a.npz")


def test_an_array_that_claims_everything(reader: Any, tmp_path: Path) -> None:
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(array, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)})
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("t.npy", array.getvalue())
    assert "can't be loaded" in reader.read("table", tmp_path / "a.npz")


@pytest.mark.parametrize(
    "head", ["t," + ",".join(f"q_{k}" for k in range(100_000)), "t," + "q_a," * 100_000, "," * MEGABYTE]
)
def test_a_table_of_many_columns(reader: Any, tmp_path: Path, head: str) -> None:
    (tmp_path / "a.csv").write_text(head + "\n0,1\n")
    assert "column" in reader.read("table", tmp_path / "a.csv")


def sqlite_bag(path: Path, columns: str = "data BLOB") -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        connection.execute("INSERT INTO topics VALUES (1, '/joint_states', ?, 'cdr')", (JOINT_STATE,))
        connection.execute(
            f"CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, {columns})"
        )


def test_a_column_that_computes_its_size(reader: Any, tmp_path: Path) -> None:
    sqlite_bag(tmp_path / "a.db3", "data BLOB GENERATED ALWAYS AS (zeroblob(500000000)) VIRTUAL")
    with closing(sqlite3.connect(tmp_path / "a.db3")) as connection, connection:
        connection.executemany("INSERT INTO messages (topic_id, timestamp) VALUES (1, ?)", [(k,) for k in range(100)])
    assert "is computed" in reader.read("large", tmp_path / "a.db3")


def test_pages_that_point_at_each_other(reader: Any, tmp_path: Path) -> None:
    """Each inner page of the table of messages is made to have the root's first child as all of its children."""
    file = tmp_path / "a.db3"
    sqlite_bag(file)
    with closing(sqlite3.connect(file)) as connection, connection:
        rows = ((k, STATE + bytes(900)) for k in range(20_000))
        connection.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)", rows)
        (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    data, size = bytearray(file.read_bytes()), 4096
    page = (root - 1) * size
    assert data[page] == 5, "the root has children"
    inner = [k * size for k in range(1, len(data) // size) if data[k * size] == 5 and k * size != page]
    cells = struct.unpack_from(">H", data, page + 3)[0]
    child = struct.unpack_from(">I", data, page + struct.unpack_from(">H", data, page + 12)[0])[0]
    for at in [page, *inner]:
        cells = struct.unpack_from(">H", data, at + 3)[0]
        for cell in struct.unpack_from(f">{cells}H", data, at + 12):
            struct.pack_into(">I", data, at + cell, child)
    file.write_bytes(data)
    reader.read("bag", file)


def test_a_robot_at_rest_is_no_bomb(tmp_path: Path) -> None:
    """The most that a real recording compresses: values that never change, in the recorder's own chunks."""
    from robot_ident.bags import BagWriter, Series, Topic

    stamps = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(100_000)
    names, still = tuple(f"joint_{k}" for k in range(7)), np.zeros((len(stamps), 7))
    with BagWriter(tmp_path / "bag", [Topic("/joint_states", JOINT_STATE)]) as bag:
        for stamp, topic, row in Series("/joint_states", names, stamps, still, still, still).messages():
            bag.write(topic, row, stamp)
    recording = read_recording(tmp_path / "bag")
    assert recording.samples == len(stamps) and recording.notes == ()
