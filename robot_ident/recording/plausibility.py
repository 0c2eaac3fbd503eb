"""Is this recording of this robot, in SI units?"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot

_BEYOND = 3.0  # positions this many times beyond the limits can't be this robot in SI units
_TOO_FAST = 10.0  # speeds this many times beyond the limits
_MOVES = 0.02  # rad or m; a joint that has moved as far has felt friction, if nothing else
_CONSTANT = 1e-9  # share of an effort within which it is one number, rounded


def check_plausible(recording: Recording, robot: Robot) -> None:
    """Raise InputError where positions or torques contradict the robot's limits by a factor, or nothing moves; torque
    at the joints. See `check_efforts` for efforts that say nothing.
    """
    reach = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    size = np.maximum(recording.q.max(axis=0), -recording.q.min(axis=0))
    for joint in range(robot.n):
        if not np.isfinite(reach[joint]) or reach[joint] <= 0 or size[joint] <= _BEYOND * reach[joint]:
            continue
        unit = "m" if robot.prismatic[joint] else "rad"
        hint = ": millimetres instead of metres?" if robot.prismatic[joint] else ": degrees instead of radians?"
        raise InputError(
            f"{recording.source}: {robot.joints[joint]} reaches {size[joint]:.4g},"
            f" its limit is {reach[joint]:.4g} {unit}{hint}"
        )
    _check_speed(recording, robot)
    torque = np.maximum(recording.tau.max(axis=0), -recording.tau.min(axis=0))
    for joint in range(robot.n):
        limit = robot.limits.torque[joint]
        if np.isfinite(limit) and torque[joint] > 20.0 * limit and not robot.in_ampere(joint):
            raise InputError(
                f"{recording.source}: the torque of {robot.joints[joint]} reaches {torque[joint]:.4g}, its limit is"
                f" {limit:.4g} {robot.torque_unit(joint)}: wrong units?"
            )
    if np.all(np.ptp(recording.q, axis=0) < 1e-6):
        raise InputError(f"{recording.source}: no joint moves; nothing can be identified from rest")


def silent_efforts(recording: Recording) -> dict[str, float]:
    """Return the joints that move while their effort is one number, and the number: nobody measured it."""
    moves = np.ptp(recording.q, axis=0) > _MOVES
    highest, lowest = recording.tau.max(axis=0), recording.tau.min(axis=0)
    same = highest - lowest <= _CONSTANT * np.maximum(highest, -lowest)
    return {
        name: float(recording.tau[0, joint])
        for joint, name in enumerate(recording.names)
        if moves[joint] and same[joint]
    }


def silent_note(silent: Mapping[str, float]) -> str:
    """Return what `silent_efforts` found, in words; empty where it found nothing."""
    if not silent:
        return ""
    which = ", ".join(f"{name} is {value:g}" for name, value in silent.items())
    moves, none = ("it moves", "its driver") if len(silent) == 1 else ("they move", "their drivers")
    return f"the effort of {which} in every sample, though {moves}: {none} publish{'es' * (len(silent) == 1)} none"


def check_efforts(recording: Recording) -> None:
    """Raise InputError where the effort of a joint that moves is one number, as read: what is fitted to it is nothing.

    The way out is a recording in which that joint stands still, since its motion moves the others.
    """
    if np.all(recording.tau == 0.0):
        raise InputError(f"{recording.source}: every torque is zero; the driver publishes no effort")
    silent = silent_efforts(recording)
    others = [name for name in recording.names if name not in silent]
    if not silent:
        return
    way = (
        ""
        if not others
        else f"; record with {', '.join(silent)} standing still, and identify --joints {','.join(others)}"
    )
    raise InputError(f"{recording.source}: {silent_note(silent)}{way}")


def _check_speed(recording: Recording, robot: Robot) -> None:
    """Raise InputError where a joint moves a tenth of the time at speeds that no joint of this robot has."""
    step = max(1, recording.samples // 1000)
    t, q = recording.t[::step], recording.q[::step]
    if len(t) < 20:
        return
    usual = np.percentile(np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None], 90.0, axis=0)
    for joint in range(robot.n):
        limit = robot.limits.velocity[joint]
        if np.isfinite(limit) and usual[joint] > _TOO_FAST * limit:
            unit = "m/s" if robot.prismatic[joint] else "rad/s"
            raise InputError(
                f"{recording.source}: {robot.joints[joint]} moves at {usual[joint]:.4g} {unit}, its limit is"
                f" {limit:.4g}: wrong units of position or time?"
            )
