"""The one place that reads and writes bags, in every form that users have them, without ROS.

`read_recording` gives joint states as arrays, `describe` says what a bag holds, `BagWriter` records serialized messages
so that every reader opens what a killed process leaves, `write_recording` writes a recording whole, `recover` mends a
bag that breaks off.
"""

from __future__ import annotations

from robot_ident.bags.bag_writer import BagWriter, Series, write_prediction, write_recording, write_series
from robot_ident.bags.read import (
    BagInfo,
    RawMessage,
    TopicInfo,
    describe,
    read_for,
    read_messages,
    read_recording,
    read_robot_description,
    topic_of_joints,
)
from robot_ident.bags.recover import BagGrowth, Recovery, recover
from robot_ident.bags.rosbag2 import Qos, qos_text
from robot_ident.bags.storage import JOINT_STATE, NUMBERS, Topic

__all__ = [
    "JOINT_STATE",
    "NUMBERS",
    "BagGrowth",
    "BagInfo",
    "BagWriter",
    "Qos",
    "RawMessage",
    "Recovery",
    "Series",
    "Topic",
    "TopicInfo",
    "describe",
    "qos_text",
    "read_for",
    "read_messages",
    "read_recording",
    "read_robot_description",
    "recover",
    "topic_of_joints",
    "write_prediction",
    "write_recording",
    "write_series",
]
