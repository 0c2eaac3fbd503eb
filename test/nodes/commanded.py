"""What was commanded, read from a bag: did position or velocity ever step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.bags import read_messages
from robot_ident.robot import load_robot


def commands(bag: Path, topic: str = "/joint_command") -> tuple[Any, Any, Any]:
    """Return stamps [N] s, positions and velocities [N, n] of the recorded commands."""
    from rclpy.serialization import deserialize_message
    from sensor_msgs.msg import JointState

    messages = [deserialize_message(raw.data, JointState) for raw in read_messages(bag, [topic])]
    t = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    return t - t[0], np.array([m.position for m in messages]), np.array([m.velocity for m in messages])


def assert_smooth(bag: Path, topic: str = "/joint_command") -> None:
    """No commanded step: positions agree with velocities, and velocities change by no more than the limit allows."""
    t, q, dq = commands(bag, topic)
    limits = load_robot().limits
    dt = np.diff(t)[:, None]
    assert np.all(np.abs(np.diff(dq, axis=0)) <= 1.02 * limits.acceleration * dt + 1e-6)
    assert np.all(np.abs(dq) < limits.velocity)
    mean = 0.5 * (dq[1:] + dq[:-1])
    np.testing.assert_array_less(np.abs(np.diff(q, axis=0) - mean * dt), 0.1 * limits.acceleration * dt**2 + 1e-6)
