"""A robot whose files would know the drive gains that recordings told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot_ident.estimation.gains import Gains
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import definition_of, robot_of


def robot_with(robot: Robot, gains: Gains) -> Robot:
    """Return a robot whose files would know these gains: torque constants, or relative gains where the unit stays A."""
    definition = definition_of(robot)
    data: dict[str, Any] = dict(definition.yaml)
    joints: Mapping[str, Any] = data.get("joints") or {}
    made = {name: dict(joints.get(name) or {}) for name in robot.joints}
    for k, name in enumerate(gains.joints):
        value = float(gains.values[k]) * (robot.effort.of(name).relative or 1.0)
        if name in gains.unknown:
            told = made[name].get("effort", {})
            told = {"quantity": told} if isinstance(told, str) else dict(told)
            made[name]["effort"] = {**told, "relative_gain": value}
        else:
            made[name]["torque_constant"] = value
    data["joints"] = made
    return robot_of(Definition(data, definition.urdf), robot.source)
