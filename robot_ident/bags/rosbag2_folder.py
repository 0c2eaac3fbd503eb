"""A rosbag2 folder: one or several storage files, with the `metadata.yaml` that says which, where there is one."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags.compression import ScratchFolder, unpack_file
from robot_ident.bags.mcap_file import McapFile
from robot_ident.bags.rosbag2_metadata import OPEN
from robot_ident.bags.sqlite_file import SqliteFile
from robot_ident.bags.storage import Batch, Storage, Topic, one_line
from robot_ident.errors import InputError

METADATA = "metadata.yaml"
_LONGEST = 1 << 23  # characters of a metadata.yaml that are read: a hundred thousand topics
FILES: dict[str, Callable[[Path], Storage]] = {".mcap": McapFile, ".db3": SqliteFile}


class UnpackedFile:
    """A storage file that rosbag2 compressed as a whole (`--compression-mode file`), unpacked into a temporary one."""

    def __init__(self, path: Path) -> None:
        """Unpack and open it."""
        self._scratch = ScratchFolder()
        place = self._scratch.path / path.stem
        try:
            note = unpack_file(path, place)
            self._inner = open_file(place, path)
        except OSError as error:
            raise InputError(f"{path}: can't be unpacked into {self._scratch.path} ({error.strerror})") from error
        except InputError as error:
            raise InputError(str(error).replace(str(place), str(path))) from error
        self._notes = (note,) if note else ()
        self.form = f"compressed {self._inner.form}"
        self.topics, self.counts = self._inner.topics, self._inner.counts
        self.batches = self._inner.batches

    @property
    def truncated(self) -> bool:
        """Whether the compressed file or its content breaks off."""
        return bool(self._notes) or self._inner.truncated

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found lost so far."""
        return self._notes + self._inner.notes


def open_file(path: Path, shown: Path | None = None) -> Storage:
    """Open one storage file by its suffix; InputError when there is none for it."""
    if path.suffix == ".zstd":
        return UnpackedFile(path)
    if path.suffix not in FILES:
        raise InputError(f"{shown or path}: is no bag file; known: {', '.join(sorted(FILES))}")
    return FILES[path.suffix](path)


class Rosbag2Directory:
    """Storage of a rosbag2 folder; the files that are there count, whatever `metadata.yaml` says."""

    def __init__(self, path: Path) -> None:
        """Open every storage file; InputError when there is none or none can be read."""
        self.path = path
        self._own_notes: list[str] = []
        metadata = self._read_metadata()
        self._parts: list[Storage] = []
        refused: list[InputError] = []
        for file in self._find_files(metadata):
            try:
                self._parts.append(open_file(file))
            except InputError as error:
                refused.append(error)
        if not self._parts:
            raise refused[0]
        self._own_notes += [f"left out: {error}" for error in refused]
        kinds = sorted({part.form.removesuffix(" file") for part in self._parts})
        self.form = f"rosbag2 folder ({', '.join(kinds)})"
        self._merge_topics()
        announced = metadata.get("message_count")
        if isinstance(announced, int) and announced != sum(self.counts):
            self._own_notes.append(f"{METADATA} announces {announced} messages, the files hold {sum(self.counts)}")

    def _read_metadata(self) -> Mapping[str, Any]:
        """Return what `metadata.yaml` says of a bag that was closed, nothing where it can't be used, and note why."""
        from robot_ident.configuration import load_yaml

        try:
            with (self.path / METADATA).open(encoding="utf-8") as file:
                content = load_yaml(file.read(_LONGEST), aliases=True)["rosbag2_bagfile_information"]
            if isinstance(content, dict) and OPEN in (content.get("custom_data") or {}):
                self._own_notes.append(f"{self.path.name}: the recorder was not closed properly")
                return {}  # it says how far the bag had come before
            if isinstance(content, dict):
                return content
            self._own_notes.append(f"{METADATA} holds no information and is not used")
        except FileNotFoundError:
            self._own_notes.append(f"{self.path.name} has no {METADATA}: the recorder was not closed properly")
        except (OSError, ValueError, TypeError, LookupError):
            self._own_notes.append(f"{METADATA} can't be read and is not used")
        return {}

    def _find_files(self, metadata: Mapping[str, Any]) -> list[Path]:
        suffixes = tuple(suffix + end for suffix in FILES for end in ("", ".zstd"))
        there = [file for file in self.path.iterdir() if file.is_file() and file.name.endswith(suffixes)]
        plain = {file.name for file in there}
        there = [file for file in there if file.suffix != ".zstd" or file.stem not in plain]
        listed = metadata.get("relative_file_paths")
        for name in listed if isinstance(listed, list) else []:
            base = Path(name).name if isinstance(name, str) else ""
            if base and not any(file.name in (base, f"{base}.zstd") or f"{file.name}.zstd" == base for file in there):
                self._own_notes.append(f"{one_line(base)} is named in {METADATA} but missing")
        if not there:
            raise InputError(f"{self.path}: is no bag; the folder holds no {' or '.join(FILES)} file")
        return sorted(there, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)])

    def _merge_topics(self) -> None:
        merged: dict[tuple[str, str, str], Topic] = {}
        for part in self._parts:
            for topic in part.topics:
                known = merged.setdefault(topic.key, topic)
                if not known.definition and topic.definition:
                    merged[topic.key] = replace(topic, qos=known.qos or topic.qos)
        self.topics = tuple(merged.values())
        keys = list(merged)
        indices = ([keys.index(topic.key) for topic in part.topics] for part in self._parts)
        self._places = [np.array(index, dtype=np.int64) for index in indices]
        counts = np.zeros(len(keys), dtype=np.int64)
        for part, places in zip(self._parts, self._places, strict=True):
            np.add.at(counts, places, np.array(part.counts, dtype=np.int64))
        self.counts: tuple[int, ...] = tuple(counts.tolist())

    @property
    def truncated(self) -> bool:
        """Whether any of the files breaks off."""
        return any(part.truncated for part in self._parts)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was found lost or out of date."""
        return tuple(self._own_notes) + tuple(note for part in self._parts for note in part.notes)

    def batches(self, wanted: Collection[int] | None = None) -> Iterator[Batch]:
        """Yield the messages of the wanted topics, file by file."""
        for part, places in zip(self._parts, self._places, strict=True):
            inside = None if wanted is None else [index for index, place in enumerate(places) if int(place) in wanted]
            if inside is None or inside:
                for batch in part.batches(inside):
                    yield replace(batch, topic=places[batch.topic])
