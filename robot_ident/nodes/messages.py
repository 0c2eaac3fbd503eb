"""Between messages about joints and arrays, joints matched by name; and what an installed message package says of its
types, for the schema of a bag's channels.
"""

from __future__ import annotations

import importlib.util
import json
import os
import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_ident.playback.windows import Window
from robot_ident.signals.motion import Array, Motion


def stamp_of(message: JointState | JointTrajectory) -> int:
    """Return the header stamp [ns], 0 where there is none."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def time_message(stamp_ns: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def joint_state(
    joints: Sequence[str], stamp_ns: int, q: Array | None = None, dq: Array | None = None, tau: Array | None = None
) -> JointState:
    """Return a message of positions, velocities and efforts [n]; what is None stays empty."""
    message = JointState(name=list(joints))
    message.header.stamp = time_message(stamp_ns)
    message.position = [] if q is None else q.tolist()
    message.velocity = [] if dq is None else dq.tolist()
    message.effort = [] if tau is None else tau.tolist()
    return message


def trajectory(joints: Sequence[str], window: Window, now_ns: int) -> JointTrajectory:
    """Return a window about the instant `now_ns` [ns] as a message, stamped with its first point's instant."""
    message = JointTrajectory(joint_names=list(joints))
    message.header.stamp = time_message(now_ns + round(window.t[0] * 1e9))
    since_ns = [round(1e9 * since) for since in window.t - window.t[0]]
    rows = zip(window.motion.q, window.motion.dq, window.motion.ddq, since_ns, strict=True)
    message.points = [
        JointTrajectoryPoint(
            positions=q.tolist(),
            velocities=dq.tolist(),
            accelerations=ddq.tolist(),
            time_from_start=Duration(sec=since // 1_000_000_000, nanosec=since % 1_000_000_000),
        )
        for q, dq, ddq, since in rows
    ]
    return message


def labelled(matrix: Array, names: Sequence[str]) -> Float64MultiArray:
    """Return a matrix [n, n], row by row, each dimension labelled with all names, one space between any two."""
    n = len(names)
    dimensions = [MultiArrayDimension(label=" ".join(names), size=n, stride=stride) for stride in (n * n, n)]
    return Float64MultiArray(layout=MultiArrayLayout(dim=dimensions), data=matrix.ravel().tolist())


def columns(message: JointState, joints: Sequence[str]) -> tuple[Array, Array | None, Array | None] | None:
    """Return position, velocity and effort [n] of the joints; None for a field that is missing, or where a joint is."""
    names = list(message.name)
    if any(joint not in names for joint in joints) or len(message.position) != len(names):
        return None
    pick = [names.index(joint) for joint in joints]
    q, dq, tau = (
        np.asarray(values, dtype=float)[pick] if len(values) == len(names) else None
        for values in (message.position, message.velocity, message.effort)
    )
    return (q, dq, tau) if q is not None else None


def points_of(message: JointTrajectory, joints: Sequence[str]) -> tuple[Array, Motion] | None:
    """Return times from the start [K] s and motion [K, n]; None where a joint or one of the three quantities lacks."""
    names = list(message.joint_names)
    if any(joint not in names for joint in joints) or not message.points:
        return None
    pick = [names.index(joint) for joint in joints]
    rows = [(p.positions, p.velocities, p.accelerations) for p in message.points]
    if any(len(values) != len(names) for row in rows for values in row):
        return None
    q, dq, ddq = (np.array([row[k] for row in rows], dtype=float)[:, pick] for k in range(3))
    t = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points])
    return t, Motion(q, dq, ddq)


_FIELD = re.compile(r"^\s*([A-Za-z][\w/]*)(?:<=\d+)?(?:\[[^\]]*\])?\s+[A-Za-z]\w*", re.MULTILINE)
_PRIMITIVES = frozenset(["bool", "byte", "char", "string", "wstring", "float32", "float64"]) | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}
_SEPARATOR = "=" * 80


def definition_of(kind: str) -> tuple[str, str]:
    """Return the text of a message type (`my_msgs/msg/Force`) with that of all it holds, and its RIHS01 hash.

    In the language `ros2msg`, as rosbag2 writes it into a bag; either is empty where the package doesn't say.
    """
    package, _, name = kind.partition("/msg/")
    text = _text(package, name)
    parts = [text] if text else []
    waiting, seen = list(_inner(text, package)), {(package, name)}
    while waiting:
        inner = waiting.pop(0)
        if inner in seen:
            continue
        seen.add(inner)
        content = _text(*inner)
        if not content:
            return "", _hash(package, name)  # half a definition can't be read by anyone
        parts.append(f"{_SEPARATOR}\nMSG: {inner[0]}/{inner[1]}\n{content}")
        waiting += _inner(content, inner[0])
    return "\n".join(parts), _hash(package, name)


def _inner(text: str, package: str) -> Iterator[tuple[str, str]]:
    """Yield package and name of the types that a definition's fields have."""
    for kind in _FIELD.findall("\n".join(line.partition("#")[0] for line in text.splitlines())):
        if kind not in _PRIMITIVES:
            *others, name = kind.split("/")
            yield others[0] if others else package, name


def _text(package: str, name: str) -> str:
    file = _file(package, f"{name}.msg")
    return file.read_text(encoding="utf-8", errors="replace") if file else ""


def _hash(package: str, name: str) -> str:
    file = _file(package, f"{name}.json")
    if file is None:
        return ""
    entries = json.loads(file.read_text(encoding="utf-8")).get("type_hashes", [])
    return next((str(e["hash_string"]) for e in entries if e.get("type_name") == f"{package}/msg/{name}"), "")


@cache
def _file(package: str, name: str) -> Path | None:
    """Return a file that a package installs beside its definitions: under a prefix of ROS, or of its Python module."""
    prefixes = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    module = importlib.util.find_spec(package)
    if module is not None and module.origin:
        prefixes += Path(module.origin).parents
    return next((file for prefix in prefixes if (file := prefix / "share" / package / "msg" / name).is_file()), None)
