"""One SQLite file of a rosbag2, opened for reading only; also one that its recorder never closed."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing
from functools import cached_property
from pathlib import Path

import numpy as np

from robot_ident.bags.storage import Batch, Topic, one_line, scratch_folder
from robot_ident.errors import InputError

_BATCH = 1 << 12  # messages
_BATCH_BYTES = 1 << 26
_STEPS, _STEPS_PER_BYTE, _LOOK = 10_000_000, 50, 100_000  # of SQLite's machine, which takes a few for each row
_TEXT_COLUMNS = ("name", "type", "serialization_format", "offered_qos_profiles", "type_description_hash")
# Python fails to decode what SQLite says of a table whose damaged definition it quotes
_REFUSALS = (sqlite3.Error, UnicodeDecodeError)
_SIDECARS = ("-wal", "-journal")


class SqliteFile:
    """Storage of one `.db3` file, of every schema version of rosbag2."""

    form = "SQLite file"

    def __init__(self, path: Path) -> None:
        """Read the topics; InputError when this is no bag or too damaged to list them."""
        self.path = path
        self._place = path
        self._lost = ""
        self._damaged: set[tuple[int, int]] = set()  # topic and place, so that a second reading counts them once
        try:
            if not path.stat().st_size:
                raise InputError(f"{path}: the file is empty")
            sidecars = [Path(f"{path}{end}") for end in _SIDECARS]
            if any(file.is_file() and file.stat().st_size for file in sidecars):
                self._roll_back()
            elif missing := _missing_bytes(path):
                self._lost = f"{path.name} is truncated: its last {missing} bytes are missing; what can be read is used"
            self.topics, self._numbers = self._read_topics()
        except (*_REFUSALS, OSError) as error:
            raise InputError(f"{path}: is no readable SQLite bag ({one_line(error)})") from error

    def _connect(self) -> sqlite3.Connection:
        """Open without locks and side files: nothing is ever written beside a recording."""
        connection = sqlite3.connect(f"{self._place.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
        connection.text_factory = lambda text: text.decode("utf-8", errors="replace")
        # pages that point at each other in a circle would hold more rows than bytes
        looks = iter(range((_STEPS + _STEPS_PER_BYTE * self._place.stat().st_size) // _LOOK))
        connection.set_progress_handler(lambda: next(looks, None) is None, _LOOK)
        return connection

    def _roll_back(self) -> None:
        """Work an unfinished journal into a copy, since the original is never written to."""
        self._place = scratch_folder(self) / self.path.name
        for end in ("", *_SIDECARS):
            if Path(f"{self.path}{end}").exists():
                shutil.copyfile(f"{self.path}{end}", f"{self._place}{end}")
        with closing(sqlite3.connect(self._place)) as connection:
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._lost = f"{self.path.name} was not closed by its recorder; what had been committed is used"

    def _read_topics(self) -> tuple[tuple[Topic, ...], tuple[int, ...]]:
        with closing(self._connect()) as connection:
            tables = {str(row[0]) for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            for table in ("topics", "messages", "message_definitions"):
                computed = [str(row[1]) for row in connection.execute(f"PRAGMA table_xinfo({table})") if row[6]]
                if computed:  # which no recorder writes and which may be any size
                    raise InputError(
                        f"{self.path}: column {one_line(computed[0])!r} of table {table!r} is computed; no bag's is"
                    )
            if not {"topics", "messages"} <= tables:
                raise InputError(
                    f"{self.path}: is a SQLite file but no bag (no tables 'topics' and 'messages'; it has: "
                    f"{one_line(*sorted(tables)) or 'none'})"
                )
            definitions: dict[str, tuple[str, str]] = {}
            if "message_definitions" in tables:
                query = "SELECT topic_type, encoded_message_definition, encoding FROM message_definitions"
                definitions = {str(kind): (str(text), str(code)) for kind, text, code in connection.execute(query)}
            columns = {str(row[1]) for row in connection.execute("PRAGMA table_info(topics)")}
            chosen = [name if name in columns else f"'' AS {name}" for name in _TEXT_COLUMNS]
            topics, numbers = [], []
            for number, *texts in connection.execute(f"SELECT id, {', '.join(chosen)} FROM topics ORDER BY id"):
                name, kind, encoding, qos, type_hash = (str(text) for text in texts)
                topics.append(Topic(name, kind, encoding, *definitions.get(kind, ("", "")), qos, type_hash))
                numbers.append(int(number))
        return tuple(topics), tuple(numbers)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """The number of messages of each topic."""
        try:
            with closing(self._connect()) as connection:
                query = "SELECT topic_id, count(*) FROM messages GROUP BY topic_id"
                counted = dict(connection.execute(query).fetchall())
            return tuple(int(counted.get(number, 0)) for number in self._numbers)
        except _REFUSALS:  # damaged further on: count what can be read
            found = np.zeros(len(self.topics), dtype=np.int64)
            for batch in self.batches():
                found += np.bincount(batch.topic, minlength=len(found))
            return tuple(found.tolist())

    @property
    def truncated(self) -> bool:
        """Whether the database breaks off, or was not closed."""
        return bool(self._lost)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found lost so far."""
        damaged = (f"{self.path.name}: {len(self._damaged)} damaged rows are left out",) if self._damaged else ()
        return ((self._lost,) if self._lost else ()) + damaged

    def batches(self, wanted: Collection[int] | None = None) -> Iterator[Batch]:
        """Yield the messages of the wanted topics in the order they were written."""
        indices = range(len(self.topics)) if wanted is None else sorted(wanted)
        index_of = {self._numbers[index]: index for index in indices}
        marks = ", ".join("?" * len(index_of))
        query = f"SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY id"
        done = held = 0
        rows: list[tuple[int, int, bytes]] = []
        try:
            with closing(self._connect()) as connection:
                for number, stamp, data in connection.execute(query, tuple(index_of)):
                    if isinstance(stamp, int) and isinstance(data, bytes):
                        rows.append((index_of[number], stamp, data))
                        held += len(data)
                    else:
                        self._damaged.add((number, len(rows) + done))
                    if len(rows) == _BATCH or held > _BATCH_BYTES:
                        done += len(rows)
                        yield _batch(rows)
                        rows, held = [], 0
        except _REFUSALS as error:
            done += len(rows)
            self._lost = f"{self.path.name} is damaged after {done} messages ({one_line(error)}); those before are used"
        if rows:
            yield _batch(rows)


def _missing_bytes(path: Path) -> int:
    """Return by how much the file is shorter than its own header says (SQLite file format, 1.3.7)."""
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100 or head[24:28] != head[92:96]:
        return 0
    page = int.from_bytes(head[16:18], "big")
    pages = int.from_bytes(head[28:32], "big")
    return max(0, pages * (65536 if page == 1 else page) - path.stat().st_size)


def _batch(rows: list[tuple[int, int, bytes]]) -> Batch:
    topics, stamps, payloads = zip(*rows, strict=True)
    return Batch.of(payloads, np.array(topics, dtype=np.int64), np.array(stamps, dtype=np.int64))
