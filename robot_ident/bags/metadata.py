"""The `metadata.yaml` of a rosbag2 folder, version 9 (Jazzy)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from robot_ident.bags.mcap_writer import Extent
from robot_ident.bags.qos import profiles_of
from robot_ident.bags.storage import Topic

VERSION = 9
OPEN = "robot_ident_recording"  # key of the custom data in a bag that nobody has closed
ROS_DISTRO = "jazzy"  # whose message definitions and hashes the bag holds


def bag_metadata(
    topics: Iterable[Topic], files: Sequence[tuple[str, Extent]], custom_data: Mapping[str, str]
) -> dict[str, Any]:
    """Return what rosbag2 calls the bag's information: topics with counts, files, start and duration."""
    filled = [extent for _, extent in files if extent.messages]
    start = min((extent.first for extent in filled), default=0)
    end = max((extent.last for extent in filled), default=0)
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
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
                "starting_time": {"nanoseconds_since_epoch": extent.start},
                "duration": {"nanoseconds": extent.duration},
                "message_count": extent.messages,
            }
            for name, extent in files
        ],
        "custom_data": dict(custom_data) or None,
        "ros_distro": ROS_DISTRO,
    }


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return block-style YAML with the keys in their order, without anchors."""
    import yaml

    class Plain(yaml.SafeDumper):
        def ignore_aliases(self, data: Any) -> bool:
            return True

    return str(yaml.dump(dict(content), Dumper=Plain, sort_keys=False, default_flow_style=False))
