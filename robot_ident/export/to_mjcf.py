"""MJCF: the arm as MuJoCo's bodies, with armature, damping and frictionloss of its joints."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from robot_ident.export.exported import CHOICE, Dynamics, Exported, about_centre
from robot_ident.robot.robot import Robot


def to_mjcf(dynamics: Dynamics) -> Exported:
    """Return the MJCF of a model: one body for each moving link, what is fixed to it included; no geometry."""
    from robot_ident.robot.symbolic import joint_axis

    robot = dynamics.model.robot
    axes = [sum(joint_axis(robot, index)) for index in range(robot.n)]
    root = ElementTree.Element("mujoco", {"model": robot.name})
    ElementTree.SubElement(root, "compiler", {"angle": "radian", "autolimits": "true"})
    ElementTree.SubElement(root, "option", {"gravity": _row(robot.rigid.model.gravity.linear)})
    parent = ElementTree.SubElement(root, "worldbody")
    for index, name in enumerate(robot.joints):
        parent = _body(parent, robot, index)
        mass, centre, inertia = about_centre(dynamics.inertias.links[10 * index : 10 * index + 10])
        six = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        own = {"pos": _row(centre), "mass": repr(mass), "fullinertia": _row(six)}
        ElementTree.SubElement(parent, "inertial", own)
        joint = {"name": name, "type": "slide" if robot.prismatic[index] else "hinge", "axis": _row(axes[index])}
        limits = robot.limits.lower[index], robot.limits.upper[index]
        if np.all(np.isfinite(limits)):
            joint["range"] = _row(limits)
        joint["armature"] = repr(float(dynamics.inertias.rotors[index]))
        joint["damping"] = repr(float(dynamics.damping[index]))
        joint["frictionloss"] = repr(float(dynamics.friction[index]))
        ElementTree.SubElement(parent, "joint", joint)
    ElementTree.indent(root)
    notes = ("the file holds no geometry: bodies, joints and their dynamics alone", CHOICE)
    return Exported({"": ElementTree.tostring(root, encoding="unicode") + "\n"}, dynamics.carried, dynamics.left, notes)


def _body(parent: ElementTree.Element, robot: Robot, index: int) -> ElementTree.Element:
    """Add the body of a joint, placed in that of the joint before."""
    import pinocchio

    model = robot.rigid.model
    placement = model.jointPlacements[1 + index]
    x, y, z, w = pinocchio.Quaternion(placement.rotation).coeffs()
    name = _link_name(robot, index)
    where = {"name": name, "pos": _row(placement.translation), "quat": _row([w, x, y, z])}
    return ElementTree.SubElement(parent, "body", where)


def _link_name(robot: Robot, index: int) -> str:
    """Return the name of the URDF's link that a joint moves."""
    import pinocchio

    for frame in robot.rigid.model.frames:
        if frame.parentJoint == 1 + index and frame.type == pinocchio.FrameType.BODY:
            return str(frame.name)
    return f"link_{index + 1}"


def _row(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, dtype=float))
