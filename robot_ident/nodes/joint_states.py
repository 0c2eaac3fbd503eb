"""Between messages about joints and arrays, joints matched by name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_ident.playing.windows import Window
from robot_ident.signals.motion import Array, Motion


def stamp_of(message: JointState | JointTrajectory) -> int:
    """Return the header stamp [ns], 0 where there is none."""
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def time_message(stamp_ns: int) -> Time:
    """Return a stamp [ns] as a message."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def duration_message(duration_ns: int) -> Duration:
    """Return a duration [ns] as a message."""
    seconds, nanoseconds = divmod(duration_ns, 1_000_000_000)
    return Duration(sec=seconds, nanosec=nanoseconds)


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
    rows = zip(window.motion.q, window.motion.dq, window.motion.ddq, window.t - window.t[0], strict=True)
    message.points = [
        JointTrajectoryPoint(
            positions=q.tolist(),
            velocities=dq.tolist(),
            accelerations=ddq.tolist(),
            time_from_start=duration_message(round(1e9 * since)),
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
