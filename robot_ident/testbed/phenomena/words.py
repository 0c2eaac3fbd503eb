"""The simulated robot's phenomena in words: what they are, their values with units."""

from __future__ import annotations

from robot_ident.robot.robot import Robot
from robot_ident.testbed.phenomena import PHYSICS
from robot_ident.testbed.phenomena.phenomenon import Physics


def formula(kind: type[Physics]) -> str:
    """Return what a phenomenon is, from its own description."""
    first = (kind.__doc__ or "").split("\n\n")[0]
    return " ".join(first.split()).replace("`", "")


def values_in_words(text: str, robot: Robot | None = None) -> str:
    """Return `NAME@JOINT:k=v,...` with rounded values and their units; without the robot, those of revolute joints."""
    label, _, values = text.partition(":")
    name, _, joint = label.partition("@")
    slides = robot is not None and joint in robot.joints and bool(robot.prismatic[robot.joint_index(joint)])
    units = (
        {p.name: p.unit_prismatic if slides else p.unit for p in PHYSICS[name].parameters} if name in PHYSICS else {}
    )
    said = []
    for item in filter(None, values.split(",")):
        key, _, number = item.partition("=")
        unit = units.get(key, "")
        said.append(f"{key} {float(number):.4g}{'' if unit in ('', '1') else f' {unit}'}")
    return f"{label}: {', '.join(said)}" if said else label
