"""Single MCAP files of every make, whole, broken off and damaged."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from robot_ident.bags import describe, read_messages, read_recording, read_robot_description
from robot_ident.bags.mcap_file import MAGIC, scan
from robot_ident.errors import InputError

MAKES = ["none", "zstd", "lz4", None]


@pytest.mark.parametrize("compression", MAKES)
@pytest.mark.parametrize("finish", [True, False])
def test_every_make(tmp_path: Path, maker: SimpleNamespace, compression: str | None, finish: bool) -> None:
    recording = maker.make_recording(400, 3)
    messages = maker.messages_of(recording)
    path = maker.write_mcap(tmp_path / "a.mcap", messages, compression=compression, finish=finish)
    got = read_recording(path)
    maker.assert_same(got, recording)
    assert got.start_ns == maker.start
    info = describe(path)
    assert info.truncated is not finish
    assert bool(got.notes) is not finish
    assert [(t.name, t.messages, t.joints, t.efforts) for t in info.topics] == [
        ("/joint_states", 400, recording.names, True)
    ]


def test_two_topics_taking_turns(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Messages of two lengths alternate, then come in long rows: the scan must follow both."""
    recording = maker.make_recording(600, 3)
    messages = maker.messages_of(recording)
    path = tmp_path / "a.mcap"
    command = maker.serialise(recording.names, 1, recording.q[0], recording.dq[0])
    with path.open("wb") as file:
        from mcap.writer import Writer

        writer = Writer(file, use_chunking=False)
        writer.start("ros2")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        states, commands = (
            writer.register_channel(name, "cdr", schema) for name in ("/joint_states", "/joint_command")
        )
        for k, (log, data) in enumerate(messages):
            writer.add_message(states, log, data, log)
            if k % 7 < 3 or k < 200:
                writer.add_message(commands, log, command, log)
        writer.finish()
    maker.assert_same(read_recording(path), recording)
    assert describe(path).messages == 600 + 200 + sum(k % 7 < 3 for k in range(200, 600))


def whole_before(path: Path, cut: int, log_of: dict[bytes, int]) -> int:
    """Return how many messages lie whole before a byte of an unchunked or uncompressed file, by plain search."""
    content = path.read_bytes()[:cut]
    return sum(data in content for data in log_of)


@pytest.mark.parametrize("compression", ["none", None])
def test_cut_anywhere(tmp_path: Path, maker: SimpleNamespace, compression: str | None) -> None:
    """At 20 random bytes: everything before the cut is read, and the loss is said."""
    recording = maker.make_recording(200, 3)
    messages = maker.messages_of(recording)
    path = maker.write_mcap(tmp_path / "a.mcap", messages, compression=compression)
    content = path.read_bytes()
    for cut in np.random.default_rng(3).integers(0, len(content) - 1, 20).tolist():
        torn = tmp_path / "torn.mcap"
        torn.write_bytes(content[:cut])
        expected = whole_before(path, cut, {data: log for log, data in messages})
        if not expected:
            with pytest.raises(InputError, match="torn.mcap"):
                read_recording(torn)
            continue
        got = read_recording(torn)
        assert got.samples == expected
        maker.assert_same(got, recording, slice(0, expected))
        assert "truncated" in got.notes[0]
        assert describe(torn).truncated


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_cut_in_compressed_chunks(tmp_path: Path, maker: SimpleNamespace, compression: str) -> None:
    """All whole chunks before the cut are read, at 20 random bytes, and what follows is a prefix of the rest."""
    recording = maker.make_recording(400, 3)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), compression=compression, chunk_size=8000)
    content = path.read_bytes()
    previous = 0
    for cut in sorted(np.random.default_rng(4).integers(0, len(content) - 1, 20).tolist()):
        torn = tmp_path / "torn.mcap"
        torn.write_bytes(content[:cut])
        try:
            got = read_recording(torn)
        except InputError:
            assert cut < 9000
            continue
        assert got.samples >= previous
        assert got.samples >= 400 * (cut - 20_000) / len(content)
        previous = got.samples
        maker.assert_same(got, recording, slice(0, got.samples))
    assert previous == 400


def test_torn_large_chunk_gives_its_beginning(tmp_path: Path, maker: SimpleNamespace) -> None:
    recording = maker.make_recording(3000, 7)
    messages = maker.messages_of(recording)
    for compression in ("zstd", "lz4"):
        path = maker.write_mcap(tmp_path / "a.mcap", messages, compression=compression, chunk_size=10**8)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        got = read_recording(path)
        assert got.samples > 700
        maker.assert_same(got, recording, slice(0, got.samples))


def test_zeros_after_power_loss(tmp_path: Path, maker: SimpleNamespace) -> None:
    """File systems fill the tail with zeros when the power fails before the data reached the disk."""
    recording = maker.make_recording(100, 3)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), compression=None, finish=False)
    path.write_bytes(path.read_bytes() + bytes(5000))
    got = read_recording(path)
    maker.assert_same(got, recording)
    assert "5000 bytes" in got.notes[0]


def test_damaged_chunk_is_left_out(tmp_path: Path, maker: SimpleNamespace) -> None:
    """A flipped bit must never become a torque: the chunk's checksum tells."""
    recording = maker.make_recording(400, 3)
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(recording), compression="none", chunk_size=20_000)
    content = bytearray(path.read_bytes())
    content[content.index(recording.tau[150].tobytes())] ^= 4
    path.write_bytes(content)
    got = read_recording(path)
    assert 200 < got.samples < 400
    assert "damaged and left out" in got.notes[0]
    assert set(map(tuple, got.tau)) <= set(map(tuple, recording.tau))


@pytest.mark.parametrize("compression", MAKES)
def test_random_damage_raises_nothing_else(tmp_path: Path, maker: SimpleNamespace, compression: str | None) -> None:
    messages = maker.messages_of(maker.make_recording(60, 2))
    path = maker.write_mcap(tmp_path / "a.mcap", messages, compression=compression, chunk_size=1500)
    content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    random = np.random.default_rng(5)
    readable = 0
    for _ in range(60):
        damaged = content.copy()
        damaged[random.integers(0, len(content), 3)] = random.integers(0, 256, 3)
        path.write_bytes(damaged.tobytes())
        try:
            readable += read_recording(path).samples > 0
            describe(path)
        except InputError as error:
            assert "\n" not in str(error)
    assert readable > 5


@pytest.mark.parametrize(
    "content", [b"", MAGIC, MAGIC[:5], b"hello", bytes(100), MAGIC + bytes(100), MAGIC + b"\x01" * 99]
)
def test_no_bag(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.mcap: ") as caught:
        read_recording(path)
    assert "\n" not in str(caught.value)


def test_chunk_that_claims_terabytes(tmp_path: Path, maker: SimpleNamespace) -> None:
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(maker.make_recording(50)), compression="zstd")
    content = bytearray(path.read_bytes())
    chunk = next(
        start for code, start, _ in scan(np.frombuffer(bytes(content), np.uint8), 8, len(content)).others if code == 6
    )
    content[chunk + 16 : chunk + 24] = (1 << 42).to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(InputError, match="claims 4398046511104 bytes"):
        read_recording(path)


def test_topics_between_others_are_skipped_unopened(tmp_path: Path, maker: SimpleNamespace) -> None:
    """Chunks of a camera are not decompressed: one with a wrong checksum does not even show."""
    recording = maker.make_recording(100, 3)
    images = [(log - 10**9, bytes(3000)) for log, _ in maker.messages_of(recording)]
    path = maker.write_mcap(
        tmp_path / "a.mcap",
        maker.messages_of(recording),
        compression="none",
        chunk_size=30_000,
        others=[("/camera", "sensor_msgs/msg/Image", "cdr", images)],
    )
    content = bytearray(path.read_bytes())
    content[content.index(bytes(2000)) + 1000] = 1
    path.write_bytes(content)
    got = read_recording(path)
    maker.assert_same(got, recording)
    assert got.notes == ()


def test_a_channel_that_the_summary_does_not_know(tmp_path: Path, maker: SimpleNamespace) -> None:
    """A second chunk that names a channel of its own, put in before the summary of a whole file: left out, and said."""
    recording = maker.make_recording(50)
    messages = maker.messages_of(recording)
    path = maker.write_mcap(tmp_path / "a.mcap", messages)
    other = maker.write_mcap(
        tmp_path / "b.mcap", messages[:5], topic="/elsewhere", others=[("/filler", "std_msgs/msg/String", "cdr", [])]
    )
    content, chunk = path.read_bytes(), next(c for c in records_of(other.read_bytes()) if c[0] == 6)
    end = next(at for at, record in places_of(content) if record[0] == 15)  # DataEnd
    path.write_bytes(content[:end] + chunk + content[end:])
    maker.assert_same(read_recording(path), recording)
    assert [raw.topic.name for raw in read_messages(path)] == ["/joint_states"] * 50


@pytest.mark.parametrize("bit", [0, 1, 3])
def test_an_index_that_names_another_channel_hides_nothing(tmp_path: Path, maker: SimpleNamespace, bit: int) -> None:
    """The index is a hint, the chunks are the truth."""
    messages = maker.messages_of(maker.make_recording(300))
    others = [("/other", "sensor_msgs/msg/JointState", "cdr", messages[:100])]
    path = maker.write_mcap(tmp_path / "a.mcap", messages, others=others, chunk_size=5000)
    content = bytearray(path.read_bytes())
    for at in [at for at, (opcode, *_) in places_of(bytes(content)) if opcode == 7][-3:]:
        content[at + 9] ^= 1 << bit
    path.write_bytes(content)
    maker.assert_same(read_recording(path, topic="/joint_states"), maker.make_recording(300))


def test_a_robot_description_without_a_message(tmp_path: Path, maker: SimpleNamespace) -> None:
    silent = [("/robot_description", "std_msgs/msg/String", "cdr", [])]
    path = maker.write_mcap(tmp_path / "a.mcap", maker.messages_of(maker.make_recording(5)), others=silent)
    with pytest.raises(InputError, match=r"topic /robot_description holds no message; give the URDF as a file"):
        read_robot_description(path)


def places_of(content: bytes) -> list[tuple[int, bytes]]:
    """Return place and bytes of each record."""
    at, found = len(MAGIC), []
    while at + 9 <= len(content) - len(MAGIC):
        size = int.from_bytes(content[at + 1 : at + 9], "little")
        found.append((at, content[at : at + 9 + size]))
        at += 9 + size
    return found


def records_of(content: bytes) -> list[bytes]:
    return [record for _, record in places_of(content)]
