"""Bags as the drivers of two real robots write them: names, order, topics and units are theirs, the robots simulated.

Sources: ur_robot_driver (motor current in A as effort, joints in the order of the hardware interfaces' map, speed
scaling in percent) and franka_ros2 (link-side torque of seven joints at 1 kHz on /franka/joint_states, the gripper's
two fingers with zeros on a topic of their own, both merged at 30 Hz by joint_state_publisher on /joint_states).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robot_ident.bags.bag_writer import BagWriter, Series
from robot_ident.bags.rosbag2 import Qos, qos_text
from robot_ident.bags.storage import JOINT_STATE, Topic
from robot_ident.robot import Robot, load_robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.simulation import simulate
from robot_ident.trajectories.point_to_point import PointToPoint

START = 1_760_000_000_000_000_000
"""Stamp of the first message [ns]."""

LATCHED = qos_text([Qos(durability="transient_local")])


@dataclass(frozen=True)
class Course:
    """What a robot does and feels at its samples: t [N] s, q, dq, tau [N, n], with noise."""

    t: Array
    q: Array
    dq: Array
    tau: Array


def described(folder: Path, urdf: Path, joints: dict[str, dict[str, float]], simulation: dict[str, object]) -> Robot:
    """Return the robot as it truly is, for simulation alone."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {
        "schema": "robot_ident/robot/1",
        "name": "true",
        "urdf": str(urdf),
        "joints": joints,
        "simulation": simulation,
        "self_collision": {"check": False},
    }
    path = folder / "true.yaml"
    path.write_text(json.dumps(content), encoding="utf-8")
    return load_robot(path)


def moves(robot: Robot, seed: int, stations: int, *, pace: float = 0.5, reach: float = 1.0) -> PointToPoint:
    """Return a program: from a home pose through stations and back, smooth moves with half a second at each."""
    rng = np.random.default_rng(seed)
    lower, upper = np.maximum(robot.limits.lower, -2.0), np.minimum(robot.limits.upper, 2.0)
    middle, half = (lower + upper) / 2.0, reach * (upper - lower) / 2.0
    home = middle + 0.3 * half * rng.uniform(-1, 1, robot.n)
    visited = middle + 0.8 * half * rng.uniform(-1, 1, (stations, robot.n))
    points = np.vstack([home, visited, home])
    return PointToPoint(
        robot.name, robot.joints, points, pace * robot.limits.velocity, pace * robot.limits.acceleration, "smooth", 0.5
    )


def worked(
    robot: Robot, program: PointToPoint, cycles: int, *, rate: float, effects: Sequence[str], seed: int
) -> Course:
    """Return a robot that works: cycles of a program with waits of 0.4 to 2 s between them, fresh noise in each.

    The second of two passes is what repeats: it begins where the first has left the arm, sagged and with its friction
    as it was, so that no joint jumps when the next cycle begins.
    """
    passes = replace(program, points=np.vstack([program.points, program.points[1:]]), pace=np.tile(program.pace, 2))
    quiet = simulate(robot, passes, sample_rate=rate, effects=effects, noise=0.0).recording
    quiet = quiet[slice(round(program.duration * rate), None)]
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(cycles):
        wait = int(rate * rng.uniform(0.4, 2.0))
        still = [np.repeat(x[-1:], wait, axis=0) for x in (quiet.q, np.zeros_like(quiet.q), quiet.tau)]
        parts.append([np.vstack(pair) for pair in zip((quiet.q, quiet.dq, quiet.tau), still, strict=True)])
    q, dq, tau = (np.vstack(column) for column in zip(*parts, strict=True))
    sigma_q, sigma_tau = np.sqrt(robot.noise.position_variance), np.sqrt(robot.noise.torque_variance)
    return Course(
        np.arange(len(q)) / rate,
        q + sigma_q * rng.standard_normal(q.shape),
        dq + 20.0 * sigma_q * rng.standard_normal(q.shape),
        tau + sigma_tau * rng.standard_normal(q.shape),
    )


UR_ORDER = ("shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3", "shoulder_pan")
"""The order in which joint_state_broadcaster names a UR's joints."""

UR_CONSTANT = {
    "shoulder_pan": 12.0,
    "shoulder_lift": 12.0,
    "elbow": 11.0,
    "wrist_1": 9.5,
    "wrist_2": 9.5,
    "wrist_3": 9.5,
}
"""Torque per ampere [Nm/A] on the joint side, gear included."""


def write_ur10e_bag(path: Path, robot: Robot, course: Course, urdf: Path) -> None:
    """Write what `ros2 bag record` takes of a UR10e with its ROS 2 driver: currents [A] as effort at 500 Hz."""
    names = tuple(f"{word}_joint" for word in UR_ORDER)
    order = [robot.joint_index(name) for name in names]
    constants = np.array([UR_CONSTANT[word] for word in UR_ORDER])
    scaling, states = "/speed_scaling_state_broadcaster/speed_scaling", "/joint_states"
    topics = [
        Topic(states, JOINT_STATE, qos=qos_text([Qos()])),
        Topic(scaling, "std_msgs/msg/Float64", qos=qos_text([Qos()])),
        Topic("/robot_description", "std_msgs/msg/String", qos=LATCHED),
    ]
    stamps = START + np.rint(1e9 * course.t).astype(np.int64)
    with BagWriter(path, topics) as bag:
        bag.write("/robot_description", text_message(urdf.read_text(encoding="utf-8")), int(stamps[0]))
        for stamp in stamps[::5]:
            bag.write(scaling, b"\0\1\0\0" + struct.pack("<d", 100.0), int(stamp))
        for stamp, topic, row in Series(
            states, names, stamps, course.q[:, order], course.dq[:, order], course.tau[:, order] / constants
        ).messages():
            bag.write(topic, row, stamp)


def write_franka_bag(path: Path, robot: Robot, course: Course, urdf: Path) -> None:
    """Write what `ros2 bag record -a` takes of a Franka with its ROS 2 driver: link-side torque [Nm] at 1 kHz."""
    arm, merged, hand = "/franka/joint_states", "/joint_states", "/franka_gripper/joint_states"
    fingers = ("panda_finger_joint1", "panda_finger_joint2")
    topics = [
        *(Topic(name, JOINT_STATE, qos=qos_text([Qos()])) for name in (merged, arm, hand)),
        Topic("/robot_description", "std_msgs/msg/String", qos=LATCHED),
    ]
    stamps = START + np.rint(1e9 * course.t).astype(np.int64)
    slow = slice(None, None, 33)
    width = np.full((len(stamps[slow]), 2), 0.035)
    nothing = np.zeros_like(width)

    def beside(values: Array, of_fingers: Array) -> Array:
        return np.hstack([values[slow], of_fingers])

    with BagWriter(path, topics) as bag:
        bag.write("/robot_description", text_message(urdf.read_text(encoding="utf-8")), int(stamps[0]))
        for stamp, topic, row in Series(hand, fingers, stamps[slow], width, nothing, nothing).messages():
            bag.write(topic, row, stamp)
        both = (beside(course.q, width), beside(course.dq, nothing), beside(course.tau, nothing))
        for stamp, topic, row in Series(merged, (*robot.joints, *fingers), stamps[slow], *both).messages():
            bag.write(topic, row, stamp)
        for stamp, topic, row in Series(arm, robot.joints, stamps, course.q, course.dq, course.tau).messages():
            bag.write(topic, row, stamp)


def text_message(text: str) -> bytes:
    """Return a std_msgs/String in CDR."""
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def ur10e_at_work(folder: Path, robots: Path, cycles: int = 8, only: str = "") -> Course:
    """Write bags `empty`, `loaded` (5 kg at the flange) and `fresh` of a UR10e with a hose that pulls at its base.

    only: that bag alone. Return what the last one truly holds: positions, speeds and torque in Nm, in the order of the
    chain.
    """
    urdf = robots / "ur_description/urdf/ur10_joint_limited_robot.urdf"
    words = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    joints = [f"{word}_joint" for word in words]
    noise = [1.0] * 3 + [0.1] * 3
    drives = {
        joint: {"torque_variance": v, "position_variance": 1e-9, "velocity": 2.0, "acceleration": 6.0}
        for joint, v in zip(joints, noise, strict=True)
    }
    friction = dict(zip(joints, [12.0] * 3 + [2.5] * 3, strict=True))
    true = described(folder / "true", urdf, drives, {"viscous": friction, "coulomb": friction})
    hose = "cable@shoulder_pan_joint:cable=10,relaxed=0.3,rubbing=0"
    load = "payload:payload=5.0,x=0,y=0,z=0"
    course = None
    for name, seed, count, effects in (
        ("empty", 1, cycles, [hose]),
        ("loaded", 2, cycles, [hose, load]),
        ("fresh", 3, 3, [hose]),
    ):
        if only not in ("", name):
            continue
        course = worked(true, moves(true, seed, 4, pace=0.9), count, rate=500.0, effects=effects, seed=seed)
        write_ur10e_bag(folder / name, true, course, urdf)
    assert course is not None
    return course


def franka_at_work(folder: Path, robots: Path, cycles: int = 8, only: str = "") -> Course:
    """Write bags `morning`, `noon` and `fresh` of a Franka with a hose along its first axis.

    only: that bag alone. Return what the last one truly holds.
    """
    urdf = robots / "panda_description/urdf/panda.urdf"
    joints = [f"panda_joint{k}" for k in range(1, 8)]
    drives = {
        joint: {"torque_variance": 0.01, "position_variance": 1e-10, "velocity": 1.5, "acceleration": 4.0}
        for joint in joints
    }
    true = described(folder / "true", urdf, drives, {})
    cable = "cable@panda_joint1:cable=4,relaxed=0.2,rubbing=0"
    course = None
    for name, seed, count in (("morning", 1, cycles), ("noon", 2, cycles), ("fresh", 3, 3)):
        if only not in ("", name):
            continue
        course = worked(true, moves(true, seed, 3, pace=0.9, reach=0.6), count, rate=1000.0, effects=[cable], seed=seed)
        write_franka_bag(folder / name, true, course, urdf)
    assert course is not None
    return course
