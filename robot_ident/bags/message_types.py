"""Definitions and type hashes of the standard messages of ROS 2 Jazzy, without ROS."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from robot_ident.bags.storage import Topic


@cache
def definition_of(kind: str) -> tuple[str, str]:
    """Return the text of a message type (`sensor_msgs/msg/JointState`) and its RIHS01 hash; empty where not known."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    if kind not in store.fielddefs:
        return "", ""
    return store.generate_msgdef(kind, ros_version=2)[0], store.hash_rihs01(kind)


def complete(topic: Topic) -> Topic:
    """Return the topic with the definition and hash of its type, where it has none and the type is a standard one."""
    if topic.definition and topic.type_hash:
        return topic
    definition, type_hash = definition_of(topic.type)
    if topic.definition:
        return replace(topic, type_hash=type_hash)
    encoding = "ros2msg" if definition else topic.definition_encoding
    return replace(topic, definition=definition, definition_encoding=encoding, type_hash=topic.type_hash or type_hash)
