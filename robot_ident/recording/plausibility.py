"""Is this recording of this robot, in SI units?"""

from __future__ import annotations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot

_BEYOND = 3.0  # positions this many times beyond the limits can't be this robot in SI units


def check_plausible(recording: Recording, robot: Robot) -> None:
    """Raise InputError where positions or torques contradict the robot's limits by a factor, or nothing moves."""
    reach = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    size = np.abs(recording.q).max(axis=0)
    for joint in range(robot.n):
        if not np.isfinite(reach[joint]) or reach[joint] <= 0 or size[joint] <= _BEYOND * reach[joint]:
            continue
        unit = "m" if robot.prismatic[joint] else "rad"
        hint = ": millimetres instead of metres?" if robot.prismatic[joint] else ": degrees instead of radians?"
        raise InputError(
            f"{recording.source}: {robot.joints[joint]} reaches {size[joint]:.4g},"
            f" its limit is {reach[joint]:.4g} {unit}{hint}"
        )
    torque = np.abs(recording.tau).max(axis=0)
    for joint in range(robot.n):
        limit = robot.limits.torque[joint]
        if np.isfinite(limit) and torque[joint] > 20.0 * limit:
            raise InputError(
                f"{recording.source}: the torque of {robot.joints[joint]} reaches {torque[joint]:.4g}, its limit is"
                f" {limit:.4g} {robot.torque_unit(joint)}: wrong units?"
            )
    if np.all(np.ptp(recording.q, axis=0) < 1e-6):
        raise InputError(f"{recording.source}: no joint moves; nothing can be identified from rest")
    if np.all(recording.tau == 0.0):
        raise InputError(f"{recording.source}: every torque is zero; the driver publishes no effort")
