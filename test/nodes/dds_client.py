"""A DDS client that knows no ROS: reads `joint_states`, feeds `joint_command`, tells what it saw as JSON.

Runs on the Python of an environment with the `cyclonedds` wheel alone: dds_client.py GOAL SECONDS
"""

import json
import os
import sys
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.internal import InvalidSample
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


def main(goal: float, seconds: float) -> None:
    """Command joint 1 to go to `goal` [rad] within `seconds`, the others to stay; read until it has come to rest there.

    A robot whose process stood still meanwhile comes later: half a minute is waited for it.
    """
    participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1000))
    reader = DataReader(participant, Topic(participant, "rt/joint_states", JointState, qos=qos), qos=qos)
    writer = DataWriter(participant, Topic(participant, "rt/joint_command", JointState, qos=qos), qos=qos)
    stamps: list[int] = []
    first = last = None
    begun, sent = time.monotonic(), 0

    def waiting() -> bool:
        passed = time.monotonic() - begun
        there = last is not None and abs(last.position[0] - goal) < 1e-3 and abs(last.velocity[0]) < 1e-3
        return passed < seconds or (not there and passed < seconds + 30.0)

    while waiting():
        for sample in reader.take(N=1000):
            if isinstance(sample, InvalidSample):
                continue
            stamps.append(sample.header.stamp.sec * 1_000_000_000 + sample.header.stamp.nanosec)
            last = sample
            if first is None:
                first, begun = sample, time.monotonic()
        if first is not None:
            now = time.time_ns()
            stamp = Time(now // 1_000_000_000, now % 1_000_000_000)
            position = list(first.position)
            share = min(1.0, (time.monotonic() - begun) / (0.7 * seconds))
            bend = share * share * (3.0 - 2.0 * share)
            position[0] += bend * (goal - position[0])
            speed = (goal - first.position[0]) * 6.0 * share * (1.0 - share) / (0.7 * seconds)
            velocity = [speed] + [0.0] * (len(position) - 1)
            writer.write(JointState(Header(stamp, ""), list(first.name), position, velocity, []))
            sent += 1
        time.sleep(0.005)
    steps = [b - a for a, b in zip(stamps[:-1], stamps[1:], strict=True)]
    sys.stdout.write(
        json.dumps(
            {
                "received": len(stamps),
                "sent": sent,
                "names": list(last.name) if last else [],
                "position": list(last.position) if last else [],
                "effort": list(last.effort) if last else [],
                "longest_step_ms": max(steps) * 1e-6 if steps else None,
                "shortest_step_ms": min(steps) * 1e-6 if steps else None,
            }
        )
    )


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]))
