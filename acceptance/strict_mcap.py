"""Reads an MCAP file as the specification has it and holds every byte against it: a judge of what we write.

Written from https://mcap.dev/spec alone; it shares nothing with the reader and the writer of the package.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)


class Message(NamedTuple):
    """One message; times in ns."""

    topic: str
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Record(NamedTuple):
    """One record: where it begins and ends in its bytes."""

    opcode: int
    begin: int
    end: int
    content: bytes


@dataclass
class Fields:
    """The fields of a record, in order."""

    content: bytes
    at: int = 0

    def number(self, code: str) -> int:
        size = struct.calcsize("<" + code)
        (value,) = struct.unpack_from("<" + code, self.content, self.at)
        self.at += size
        return int(value)

    def raw(self, size: int) -> bytes:
        assert self.at + size <= len(self.content), "a field reaches beyond its record"
        self.at += size
        return self.content[self.at - size : self.at]

    def text(self) -> str:
        return self.raw(self.number("I")).decode("utf-8")

    def array(self, *codes: str) -> list[tuple[int, ...]]:
        end = self.number("I") + self.at
        out = []
        while self.at < end:
            out.append(tuple(self.number(code) for code in codes))
        assert self.at == end, "an array has another length than its items"
        return out

    def texts(self) -> dict[str, str]:
        end, out = self.number("I") + self.at, {}
        while self.at < end:
            key = self.text()
            assert key not in out, f"the key {key} stands twice in a map"
            out[key] = self.text()
        assert self.at == end, "a map has another length than its items"
        return out

    def rest(self) -> bytes:
        return self.raw(len(self.content) - self.at)

    def done(self) -> None:
        assert self.at == len(self.content), "bytes are left in a record"


def split(data: bytes, begin: int, end: int) -> list[Record]:
    """Return the records between two bytes, which they fill to the last one."""
    out = []
    while begin < end:
        opcode, size = struct.unpack_from("<BQ", data, begin)
        assert 1 <= opcode <= DATA_END, f"no record of the specification begins at byte {begin}"
        assert begin + 9 + size <= end, f"the record at byte {begin} reaches beyond what holds it"
        out.append(Record(opcode, begin, begin + 9 + size, data[begin + 9 : begin + 9 + size]))
        begin += 9 + size
    return out


@dataclass
class Strict:
    """What a file holds, once all of it was found as it must be."""

    path: Path
    messages: list[Message] = field(default_factory=list)
    outside: int = 0  # messages that stand in no chunk
    summary: bool = False
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    schemas: dict[int, bytes] = field(default_factory=dict)
    channels: dict[int, bytes] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    chunk_indexes: dict[int, tuple[object, ...]] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        """Read the file; AssertionError where it is not what the specification says."""
        data = self.path.read_bytes()
        assert data.startswith(MAGIC) and data.endswith(MAGIC), "the file has no magic at both ends"
        records = split(data, len(MAGIC), len(data) - len(MAGIC))
        assert records[0].opcode == HEADER and records[-1].opcode == FOOTER
        header = Fields(records[0].content)
        self.profile, self.library = header.text(), header.text()
        header.done()
        cut = next(k for k, record in enumerate(records) if record.opcode == DATA_END)
        self._data_section(records[1:cut])
        (checksum,) = struct.unpack("<I", records[cut].content)
        assert checksum in (0, zlib.crc32(data[: records[cut].begin])), "the checksum of the data section is wrong"
        self._summary_section(data, records[cut + 1 : -1], records[-1])

    # -- the data section

    def _data_section(self, records: list[Record]) -> None:
        k = 0
        while k < len(records):
            record = records[k]
            k += 1
            if record.opcode == CHUNK:
                first = k
                while k < len(records) and records[k].opcode == MESSAGE_INDEX:
                    k += 1
                self._chunk(record, records[first:k])
            elif record.opcode == METADATA:
                fields = Fields(record.content)
                name = fields.text()
                self.metadata[name] = fields.texts()
                fields.done()
            else:
                assert record.opcode in (SCHEMA, CHANNEL, MESSAGE, ATTACHMENT), f"record {record.opcode} in the data"
                self.outside += record.opcode == MESSAGE
                self._inner(record)

    def _inner(self, record: Record) -> tuple[int, int] | None:
        """Take in a schema, a channel or a message; return channel and time of a message."""
        fields = Fields(record.content)
        if record.opcode == MESSAGE:
            channel, sequence, log, sent = (fields.number(code) for code in "HIQQ")
            assert channel in self.channels, f"a message stands before its channel {channel}"
            self.messages.append(Message(self.topics[channel], sequence, log, sent, fields.rest()))
            self.counts[channel] += 1
            return channel, log
        known = self.schemas if record.opcode == SCHEMA else self.channels
        number = fields.number("H")
        assert known.setdefault(number, record.content) == record.content, "two records of one id differ"
        if record.opcode == SCHEMA:
            assert number, "a schema has the id 0"
            fields.text(), fields.text(), fields.raw(fields.number("I"))
        elif record.opcode == CHANNEL:
            schema = fields.number("H")
            assert schema == 0 or schema in self.schemas, f"the channel {number} stands before its schema {schema}"
            self.topics[number] = fields.text()
            fields.text(), fields.texts()
        fields.done()
        return None

    def _chunk(self, record: Record, indexes: list[Record]) -> None:
        fields = Fields(record.content)
        begin, end, size, checksum = (fields.number(code) for code in "QQQI")
        compression = fields.text()
        packed = fields.raw(fields.number("Q"))
        fields.done()
        content = packed
        if compression == "zstd":
            import zstandard

            content = zstandard.ZstdDecompressor().decompress(packed, max_output_size=size)
        else:
            assert compression == "", f"compression {compression!r} is not ours"
        assert len(content) == size, "a chunk has another size than it says"
        assert checksum == zlib.crc32(content), "the checksum of a chunk is wrong"
        there: dict[int, list[tuple[int, int]]] = {}
        for inner in split(content, 0, len(content)):
            assert inner.opcode in (SCHEMA, CHANNEL, MESSAGE), f"record {inner.opcode} in a chunk"
            found = self._inner(inner)
            if found:
                there.setdefault(found[0], []).append((found[1], inner.begin))
        times = [time for entries in there.values() for time, _ in entries]
        assert (begin, end) == ((min(times), max(times)) if times else (0, 0)), "the times of a chunk are wrong"
        offsets = {}
        for index in indexes:
            fields = Fields(index.content)
            channel = fields.number("H")
            entries = fields.array("Q", "Q")
            fields.done()
            assert channel not in offsets, "a channel has two indexes after one chunk"
            assert sorted(entries) == sorted(there.get(channel, [])), "an index names other messages than its chunk has"
            offsets[channel] = index.begin
        assert set(offsets) == set(there), "a chunk has messages that no index names"
        length = indexes[-1].end - record.end if indexes else 0
        self.chunk_indexes[record.begin] = (
            begin, end, record.begin, record.end - record.begin, offsets, length, compression, len(packed), size,
        )  # fmt: skip

    # -- the summary

    def _summary_section(self, data: bytes, records: list[Record], footer: Record) -> None:
        start, offsets, checksum = struct.unpack("<QQI", footer.content)
        if not start:
            assert not records and not offsets, "records stand where the footer says that no summary is"
            return
        self.summary = True
        assert start == records[0].begin, "the summary begins elsewhere"
        assert checksum == zlib.crc32(data[start : footer.begin + 9 + 16]), "the checksum of the summary is wrong"
        groups: dict[int, tuple[int, int]] = {}
        named: dict[int, tuple[int, int]] = {}
        schemas, channels, chunks, metadata = {}, {}, {}, 0
        for record in records:
            opcode, fields = record.opcode, Fields(record.content)
            if opcode == SUMMARY_OFFSET:
                assert named or record.begin == offsets, "the summary offsets begin elsewhere"
                group, first, size = (fields.number(code) for code in "BQQ")
                named[group] = (first, first + size)
                continue
            assert not named, "a record stands behind the summary offsets"
            begin, end = groups.get(opcode, (record.begin, record.begin))
            assert end == record.begin, f"the records {opcode} of the summary are not together"
            groups[opcode] = (begin, record.end)
            if opcode == SCHEMA:
                schemas[fields.number("H")] = record.content
            elif opcode == CHANNEL:
                channels[fields.number("H")] = record.content
            elif opcode == CHUNK_INDEX:
                head = tuple(fields.number(code) for code in "QQQQ")
                pairs = dict(fields.array("H", "Q"))
                tail = (fields.number("Q"), fields.text(), fields.number("Q"), fields.number("Q"))
                fields.done()
                chunks[head[2]] = (*head, pairs, *tail)
            elif opcode == METADATA_INDEX:
                at, size, name = fields.number("Q"), fields.number("Q"), fields.text()
                (there,) = split(data, at, at + size)
                assert there.opcode == METADATA and Fields(there.content).text() == name
                metadata += 1
            else:
                assert opcode == STATISTICS, f"record {opcode} in the summary"
                self._statistics(fields)
        assert STATISTICS in groups, "the summary has no statistics"
        assert {key: value for key, value in groups.items() if value[0] < value[1]} == {
            key: value for key, value in named.items() if value[0] < value[1]
        }, "the summary offsets name other places than the groups have"
        assert chunks == self.chunk_indexes, "the chunk indexes differ from the chunks"
        # a topic without a message may stand in the summary alone
        assert self.schemas.items() <= schemas.items() and self.channels.items() <= channels.items()
        assert metadata == len(self.metadata)

    def _statistics(self, fields: Fields) -> None:
        told = tuple(fields.number(code) for code in "QHIIIIQQ")
        counts = dict(fields.array("H", "Q"))
        fields.done()
        times = [message.log_time for message in self.messages] or [0]
        assert told[0] == len(self.messages), "the statistics count other messages"
        assert told[3:] == (0, len(self.metadata), len(self.chunk_indexes), min(times), max(times))
        assert told[1] >= len(self.schemas) and told[2] >= len(self.channels)
        assert +Counter(counts) == self.counts, "the statistics count other messages of a channel"


def judge(path: Path, *, ended: bool) -> list[Message]:
    """Return the messages of a file in their order; AssertionError where it isn't what a bag of ours must be.

    ended: closed in order, with index, summary and rosbag2's metadata; else the file of a recorder that was killed.
    """
    file = Strict(path)
    assert (file.profile, file.outside) == ("ros2", 0)
    times = [message.log_time for message in file.messages]
    assert times == sorted(times), "the messages are not in the order of their times"
    assert file.summary == ended, "a summary is there" if file.summary else "no summary is there"
    assert not ended or "serialized_metadata" in file.metadata["rosbag2"]
    return file.messages
