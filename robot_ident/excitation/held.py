"""An excitation of some joints as a motion of the whole robot, the others at rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.excitation.limits import certify
from robot_ident.robot.robot import Robot


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
        raise InputError(f"with {_words(angles)}: {margins.violations[0]}")
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


def _words(angles: Mapping[str, float]) -> str:
    return ", ".join(f"{name} held at {angle:.4g}" for name, angle in angles.items())
