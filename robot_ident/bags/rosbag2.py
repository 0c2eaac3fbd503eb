"""A rosbag2 folder: one or several storage files, with the `metadata.yaml` that says which, where there is one; what
rosbag2 of Jazzy (version 9) notes beside messages: quality of service, definitions and type hashes, without ROS.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags.cdr import message_types
from robot_ident.bags.mcap_file import McapFile
from robot_ident.bags.sqlite_file import SqliteFile
from robot_ident.bags.storage import Batch, Extent, Storage, Topic, one_line, scratch_folder, unpack_file
from robot_ident.errors import InputError

_LONGEST_QOS = 1 << 16  # characters; a profile takes 400
FOREVER_NS = 2**63 - 1  # how ROS 2 writes "no limit"
# the numbers that bags before metadata version 9 write, in the order of rmw/types.h
_WORDS = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown", "best_available"),
    "durability": ("system_default", "transient_local", "volatile", "unknown", "best_available"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown", "best_available"),
}


@dataclass(frozen=True)
class Qos:
    """One offered profile, in the words of `ros2 topic info --verbose`; times in ns."""

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline_ns: int = FOREVER_NS
    lifespan_ns: int = FOREVER_NS
    liveliness: str = "automatic"
    liveliness_lease_duration_ns: int = FOREVER_NS
    avoid_ros_namespace_conventions: bool = False

    def mapping(self) -> dict[str, Any]:
        """Return the keys and values that rosbag2 writes."""
        content: dict[str, Any] = {}
        for key, value in asdict(self).items():
            if key.endswith("_ns"):
                seconds, rest = divmod(value, 1_000_000_000)
                content[key.removesuffix("_ns")] = {"sec": seconds, "nsec": rest}
            else:
                content[key] = value
        return content


def qos_text(profiles: Sequence[Qos | dict[str, Any]]) -> str:
    """Return the YAML text that stands in a channel's `offered_qos_profiles`."""
    import yaml

    mappings = [profile.mapping() if isinstance(profile, Qos) else profile for profile in profiles]
    return str(yaml.safe_dump(mappings, sort_keys=False)).strip() if mappings else ""


def profiles_of(text: str) -> list[dict[str, Any]]:
    """Return the profiles of a channel's text in the words of version 9; none where the text is no list of profiles."""
    from robot_ident.configuration import NotYaml, load_yaml

    try:
        profiles = load_yaml(text) if text and len(text) <= _LONGEST_QOS else []
    except NotYaml:
        return []
    if not isinstance(profiles, list) or not all(isinstance(profile, dict) for profile in profiles):
        return []
    for profile in profiles:
        for key, words in _WORDS.items():
            number = profile.get(key)
            if isinstance(number, int):
                profile[key] = words[number] if 0 <= number < len(words) else "unknown"
    return list(profiles)


OPEN = "robot_ident_recording"  # key of the custom data in a bag that nobody has closed


def bag_metadata(
    topics: Iterable[Topic], files: Sequence[tuple[str, Extent]], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return what rosbag2 calls the bag's information: topics with counts, files, start and duration."""
    filled = [extent for _, extent in files if extent.messages]
    start = min((extent.first for extent in filled), default=0)
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": max((extent.last for extent in filled), default=0) - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(extent.messages for extent in filled),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type,
                    "serialization_format": topic.encoding,
                    "offered_qos_profiles": profiles_of(topic.qos),
                    "type_description_hash": topic.type_hash,
                },
                "message_count": sum(extent.counts.get(topic.name, 0) for _, extent in files),
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [name for name, _ in files],
        "files": [
            {
                "path": name,
                "starting_time": {"nanoseconds_since_epoch": extent.first},
                "duration": {"nanoseconds": extent.last - extent.first},
                "message_count": extent.messages,
            }
            for name, extent in files
        ],
        "custom_data": dict(custom_data) or None,
        "ros_distro": "jazzy",  # whose message definitions and hashes the bag holds
    }


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return block-style YAML with the keys in their order, without anchors."""
    import yaml

    class Plain(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            return True

    return str(yaml.dump(dict(content), Dumper=Plain, sort_keys=False, default_flow_style=False))


def complete(topic: Topic) -> Topic:
    """Return the topic with the definition and RIHS01 hash of its type, where it has none and the type is a standard
    one.
    """
    if topic.definition and topic.type_hash:
        return topic
    store = message_types()
    if topic.type not in store.fielddefs:
        return topic
    if not topic.definition:
        definition = store.generate_msgdef(topic.type, ros_version=2)[0]
        topic = replace(topic, definition=definition, definition_encoding="ros2msg")
    return replace(topic, type_hash=topic.type_hash or store.hash_rihs01(topic.type))


METADATA = "metadata.yaml"
_LONGEST_METADATA = 1 << 23  # characters of a metadata.yaml that are read: a hundred thousand topics
FILES: dict[str, Callable[[Path], Storage]] = {".mcap": McapFile, ".db3": SqliteFile}


class UnpackedFile:
    """A storage file that rosbag2 compressed as a whole (`--compression-mode file`), unpacked into a temporary one."""

    def __init__(self, path: Path) -> None:
        """Unpack and open it."""
        scratch = scratch_folder(self)
        place = scratch / path.stem
        try:
            note = unpack_file(path, place)
            self._inner = open_file(place, path)
        except OSError as error:
            raise InputError(f"{path}: can't be unpacked into {scratch} ({error.strerror})") from error
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
                content = load_yaml(file.read(_LONGEST_METADATA), aliases=True)["rosbag2_bagfile_information"]
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
