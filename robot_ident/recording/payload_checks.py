"""Whether a robot's model can hold the payload that the conditions of a recording state."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.conditions import Conditions, in_metres, sidecar
from robot_ident.robot.robot import Robot

_SMALL = 0.1  # m; a robot without links between its joints, a slide say, has no reach that tells anything


def refuse_payload(conditions: Conditions, robot: Robot, source: Path | str) -> None:
    """Raise InputError where a stated payload can't be the robot's: its centre lies farther from the flange than the
    arm is long, or a joint on the way to the flange follows another one and stands still in the model.
    """
    payload = conditions.payload
    if payload is None and not conditions.estimated:
        return
    centre = payload.centre if payload is not None else conditions.part.centre
    file, reach = sidecar(source), reach_of(robot)
    if centre is not None and _SMALL < reach < np.linalg.norm(centre):
        raise InputError(f"{file}: {in_metres(centre)} (the whole arm is {reach:.2g} m long)")
    following = followers(robot)
    if following:
        raise InputError(
            f"{file}: the model of {robot.name} can't hold a payload: on the way to the flange {', '.join(following)}"
            f" follow{'s' * (len(following) == 1)} another joint (mimic: a parallelogram or a belt) and stand"
            f"{'s' * (len(following) == 1)} still in it; give recordings without a payload"
        )


def reach_of(robot: Robot) -> float:
    """Return how long the arm is from its first joint to the end effector [m], sliding joints pushed in."""
    model = robot.rigid.model
    steps = [float(np.linalg.norm(model.jointPlacements[k].translation)) for k in range(2, robot.n + 1)]
    flange = model.frames[model.getFrameId(robot.end_effector)].placement.translation
    return sum(steps) + float(np.linalg.norm(flange))


def followers(robot: Robot) -> list[str]:
    """Return the joints on the way to the end effector that mimic others, in the order of the chain."""
    if robot.definition is None or "<mimic" not in robot.definition.urdf:
        return []
    joints = list(ElementTree.fromstring(robot.definition.urdf).iterfind("joint"))
    above = {one.get("link", ""): joint for joint in joints if (one := joint.find("child")) is not None}
    named = {joint.get("name", ""): link for link, joint in above.items()}
    link, out = named.get(robot.end_effector, robot.end_effector), []
    while link in above:
        joint = above.pop(link)
        if joint.find("mimic") is not None:
            out.append(joint.get("name", ""))
        parent = joint.find("parent")
        link = "" if parent is None else parent.get("link", "")
    return out[::-1]
