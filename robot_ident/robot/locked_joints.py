"""Some joints only: the others held at an angle, their links one body with what carries them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import definition_of, robot_of


def hold(robot: Robot, moving: Sequence[str], angles: Mapping[str, float]) -> Robot:
    """Return the arm of the joints `moving`, each other one held at its angle [rad, m].

    Links beyond a held joint merge with the link that carries them, so that the base parameters are those that the
    moving joints show at this pose; names that a robot YAML gives to base parameters don't fit it and are left out.
    Raises InputError on an unknown joint, where none or all would be held, and where drives couple both kinds.
    """
    for name in (*moving, *angles):
        robot.joint_index(name)
    held = {name: float(angles[name]) for name in robot.joints if name not in moving}
    if not moving or not held:
        raise InputError(f"robot {robot.name}: {'all' if moving else 'none'} of its joints would move")
    definition = definition_of(robot)
    data = {key: value for key, value in definition.yaml.items() if key != "base_parameters"}
    joints: Mapping[str, Any] = data.get("joints") or {}
    data["joints"] = {name: joints.get(name) or {} for name in robot.joints if name not in held}
    for name, source in robot.effort.sources.items():
        if source.index is not None and name not in held:
            data["joints"][name] = _with_field(data["joints"][name], source.field)
    data["locked"] = {**(data.get("locked") or {}), **held}
    if data.get("springs"):
        data["springs"] = {name: one for name, one in data["springs"].items() if name not in held}
    if data.get("simulation"):
        data["simulation"] = {
            effect: {name: value for name, value in by_joint.items() if name not in held}
            for effect, by_joint in data["simulation"].items()
        }
    if data.get("effects"):
        data["effects"] = [label for label in data["effects"] if label.partition("@")[2] not in held]
    if isinstance(data.get("effort"), Mapping) and data["effort"].get("coupling"):
        data["effort"] = {**data["effort"], "coupling": _apart(robot, held, data["effort"]["coupling"])}
    return robot_of(Definition(data, definition.urdf), robot.source)


def _with_field(joint: Mapping[str, Any], field: str) -> dict[str, Any]:
    """Return a joint's record that says itself where in an array its effort stands, whatever joints there are."""
    told = joint.get("effort") or {}
    return {**joint, "effort": {**({"quantity": told} if isinstance(told, str) else told), "field": field}}


def moving_joints(robot: Robot, text: str) -> tuple[str, ...]:
    """Return the joints of a list `A,B` in the order of the chain; InputError where it names none, or a stranger to the
    robot.
    """
    wanted = [word.strip() for word in text.split(",") if word.strip()]
    if not wanted:
        raise InputError(f"--joints {text!r}: names no joint; robot {robot.name} has {', '.join(robot.joints)}")
    for word in wanted:
        if word not in robot.joints:
            raise InputError(f"--joints: robot {robot.name} has no joint {word!r}{did_you_mean(word, robot.joints)}")
    return tuple(name for name in robot.joints if name in wanted)


def _apart(robot: Robot, held: Mapping[str, float], coupling: Sequence[Sequence[float]]) -> list[list[float]]:
    """Return the coupling [joint][drive] of the joints that move; InputError where they share a drive with others."""
    matrix = np.array(coupling, dtype=float)
    keep = np.array([name not in held for name in robot.joints])
    if np.any(matrix[np.ix_(keep, ~keep)]) or np.any(matrix[np.ix_(~keep, keep)]):
        raise InputError(f"robot {robot.name}: effort.coupling: drives move {', '.join(held)} and others together")
    out: list[list[float]] = matrix[np.ix_(keep, keep)].tolist()
    return out
