"""What rosbag2 of Jazzy notes beside messages: `metadata.yaml` (version 9), the quality of service of a topic,
definitions and type hashes of standard messages, without ROS.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from robot_ident.bags.cdr import message_types
from robot_ident.bags.storage import Extent, Topic

_LONGEST = 1 << 16  # characters; a profile takes 400
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
        profiles = load_yaml(text) if text and len(text) <= _LONGEST else []
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
