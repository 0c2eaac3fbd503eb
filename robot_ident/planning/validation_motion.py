"""The paper's validation motion, random points with a full stop at each; an excitation of some joints, others held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier, certify
from robot_ident.limits.feasibility import allowed_poses, require_limits
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.fourier_series import FourierSeries
from robot_ident.trajectories.point_to_point import PointToPoint

_TRIES = 400  # random points for one move
_PACES = (1.0, 0.7, 0.5, 0.35, 0.25)  # tried in turn where the full speed would take too much torque


def validation_motion(robot: Robot, seed: int, points: int = 20, pause: float = 0.0) -> PointToPoint:
    """Return a certified motion through `points` random points with maximum acceleration.

    The motion of Swevers et al. 1997, section V. Every straight move between two points keeps position, velocity,
    acceleration and the rules of the workspace. Raises InputError when limits are missing, can't be met together, or
    no point can be reached from another.
    """
    if points < 2:
        raise InputError(f"points = {points}: a motion needs two at least")
    require_limits(robot)
    certifier, rng = Certifier(robot), np.random.default_rng(seed)
    pool = allowed_poses(robot, count=_TRIES, spread=0.98, seed=seed)
    chosen, paces = [pool[0]], []
    for _ in range(points - 1):
        for k in rng.integers(len(pool), size=_TRIES):
            pace = _pace(robot, certifier, chosen[-1], pool[k])
            if pace is not None:
                chosen.append(pool[k])
                paces.append(pace)
                break
        else:
            raise InputError(
                f"{robot.name}: no straight move from {np.round(chosen[-1], 3).tolist()} stays within the limits"
            )
    return moves(robot, np.array(chosen), pause=pause, pace=np.array(paces), seed=seed)


def moves(
    robot: Robot,
    points: Array,
    *,
    law: str = "fastest",
    share: float = 1.0,
    pause: float = 0.0,
    pace: Array | None = None,
    seed: int | None = None,
) -> PointToPoint:
    """Return the motion of a robot through points [K + 1, n] with a share of its velocity and acceleration limits."""
    limits = robot.limits
    pace = np.ones(len(points) - 1) if pace is None else pace
    return PointToPoint(
        robot.name, robot.joints, points, share * limits.velocity, share * limits.acceleration, law, pause, pace, seed
    )


def _pace(robot: Robot, certifier: Certifier, start: Array, goal: Array) -> float | None:
    """Return the largest pace at which the straight move is certified, or None."""
    if np.max(np.abs(goal - start) / (robot.limits.upper - robot.limits.lower)) < 0.05:
        return None
    pair = np.array([start, goal])
    if not certifier.keeps(moves(robot, pair), torque=False):
        return None
    return next((pace for pace in _PACES if certifier.keeps(moves(robot, pair, pace=np.array([pace])))), None)


def whole_motion(excitation: Excitation, robot: Robot, angles: Mapping[str, float]) -> Excitation:
    """Return an excitation of all joints of a robot: those of `angles` [rad, m] stand there, the others move on.

    Raises InputError where the robot's limits are not kept so: an angle out of range, links that touch.
    """
    series, n = excitation.series, robot.n
    place = [robot.joint_index(name) for name in excitation.joints]
    q0, a, b = np.zeros(n), np.zeros((n, series.harmonics)), np.zeros((n, series.harmonics))
    for name, angle in angles.items():
        q0[robot.joint_index(name)] = angle
    q0[place], a[place], b[place] = series.q0, series.a, series.b
    whole = replace(
        excitation,
        robot=robot.name,
        joints=robot.joints,
        series=FourierSeries(series.base_frequency, q0, a, b),
        limits=_limits(excitation, robot, angles),
        reproduce={**excitation.reproduce, "joints": list(excitation.joints), "hold": dict(angles)},
    )
    margins = certify(whole, robot)
    if not margins.kept:
        held = ", ".join(f"{name} held at {angle:.4g}" for name, angle in angles.items())
        raise InputError(f"with {held}: {margins.violations[0]}")
    return whole


def _limits(excitation: Excitation, robot: Robot, angles: Mapping[str, float]) -> dict[str, Any]:
    """Return the limits that the motion was designed for, by joint of the whole robot: a held one has its angle."""
    out = dict(excitation.limits)
    for key in ("position", "velocity", "acceleration"):
        if key in out:
            moving = dict(zip(excitation.joints, out[key], strict=True))
            rest = {name: [angle, angle] if key == "position" else 0.0 for name, angle in angles.items()}
            out[key] = [moving.get(name, rest.get(name)) for name in robot.joints]
    return out


def check_angles(robot: Robot, angles: Mapping[str, float]) -> None:
    """Raise InputError where a joint would be held outside of its limits."""
    for name, angle in angles.items():
        joint = robot.joint_index(name)
        lower, upper = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
        if not lower < angle < upper:
            raise InputError(f"--hold {name}={angle:g}: outside of its limits, {lower:g} to {upper:g}")
