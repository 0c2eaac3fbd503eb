"""URDF: the robot's own file with the identified inertias, `damping` and `friction` of its joints."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from robot_ident.export.exported import CHOICE, Dynamics, Exported, about_centre
from robot_ident.export.inertias import FullInertias
from robot_ident.robot.robot_file import definition_of
from robot_ident.signals.motion import Array

_GRAVITY = np.array([0.0, 0.0, -9.81])


def to_urdf(dynamics: Dynamics) -> Exported:
    """Return the URDF of a model.

    Every moving link gets the inertia that the torque tells of it and of all that is fixed to it; those lose theirs.
    Visual and collision geometry and all else of the robot's own URDF stay. A joint that was locked becomes fixed at
    its angle. The format knows no rotor inertia: the links carry it where they can.
    """
    robot = dynamics.model.robot
    inertias = dynamics.inertias.without_rotors(dynamics.model.structure)
    definition = definition_of(robot)
    builder = ElementTree.TreeBuilder(insert_comments=True)
    tree = ElementTree.fromstring(definition.urdf, parser=ElementTree.XMLParser(target=builder))
    links = {link.get("name", ""): link for link in tree.findall("link")}
    joints = {joint.get("name", ""): joint for joint in tree.findall("joint")}
    angles = definition.yaml.get("locked", {})
    held = [name for name, joint in joints.items() if name not in robot.joints and joint.get("type") != "fixed"]
    locked = {name: float(angles.get(name, 0.0)) for name in held}
    for name, position in locked.items():
        _fix(joints[name], position)
    for index, name in enumerate(robot.joints):
        child = _child(joints[name])
        for other in _fixed_to(child, joints):
            _remove_inertia(links[other])
        _set_inertia(links[child], inertias.links[10 * index : 10 * index + 10])
        _set_friction(joints[name], dynamics.damping[index], dynamics.friction[index])
    ElementTree.indent(tree)
    text = '<?xml version="1.0"?>\n' + ElementTree.tostring(tree, encoding="unicode") + "\n"
    return Exported(
        {"": text},
        carried=tuple(label for label in dynamics.carried if not _is_lost(label, dynamics, inertias)),
        left=(*dynamics.left, *(label for label in dynamics.carried if _is_lost(label, dynamics, inertias))),
        notes=_notes(dynamics, inertias, locked),
        rotors={joint: float(rotor) for joint, rotor in zip(robot.joints, inertias.rotors, strict=True) if rotor},
    )


def _child(joint: ElementTree.Element) -> str:
    found = joint.find("child")
    return "" if found is None else found.get("link", "")


def _parent(joint: ElementTree.Element) -> str:
    found = joint.find("parent")
    return "" if found is None else found.get("link", "")


def _fixed_to(link: str, joints: dict[str, ElementTree.Element]) -> list[str]:
    """Return the links that move with a link, without itself."""
    out = []
    for joint in joints.values():
        if joint.get("type") == "fixed" and _parent(joint) == link:
            child = _child(joint)
            out += [child, *_fixed_to(child, joints)]
    return out


def _remove_inertia(link: ElementTree.Element) -> None:
    for own in link.findall("inertial"):
        link.remove(own)


def _set_inertia(link: ElementTree.Element, ten: Array) -> None:
    """Write mass, centre and inertia about the centre, in the link's own axes."""
    mass, centre, inertia = about_centre(ten)
    _remove_inertia(link)
    own = ElementTree.Element("inertial")
    ElementTree.SubElement(own, "origin", {"xyz": " ".join(map(_number, centre)), "rpy": "0 0 0"})
    ElementTree.SubElement(own, "mass", {"value": _number(mass)})
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(own, "inertia", {key: _number(inertia[place]) for key, place in entries.items()})
    link.insert(0, own)


def _set_friction(joint: ElementTree.Element, damping: float, friction: float) -> None:
    for own in joint.findall("dynamics"):
        joint.remove(own)
    if damping or friction:
        ElementTree.SubElement(joint, "dynamics", {"damping": _number(damping), "friction": _number(friction)})


def _fix(joint: ElementTree.Element, position: float) -> None:
    """Make a joint fixed at a position: its origin turned about, or shifted along, its axis."""
    origin = joint.find("origin")
    if origin is None:
        origin = ElementTree.SubElement(joint, "origin")
    axis = joint.find("axis")
    direction = np.array([1.0, 0.0, 0.0]) if axis is None else _vector(axis.get("xyz", "1 0 0"))
    rotation, place = _rotation(_vector(origin.get("rpy", "0 0 0"))), _vector(origin.get("xyz", "0 0 0"))
    if joint.get("type") == "prismatic":
        place = place + rotation @ direction * position
    elif position:
        rotation = rotation @ _about(direction / np.linalg.norm(direction), position)
        origin.set("rpy", " ".join(map(_number, _angles(rotation))))
    origin.set("xyz", " ".join(map(_number, place)))
    joint.set("type", "fixed")
    for word in ("axis", "limit", "dynamics", "mimic", "calibration", "safety_controller"):
        for own in joint.findall(word):
            joint.remove(own)


def _vector(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _number(value: float) -> str:
    return repr(float(value))


def _about(axis: Array, angle: float) -> Array:
    """Return Rodrigues' rotation about a unit axis."""
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross)


def _rotation(rpy: Array) -> Array:
    """Return R = Rz(yaw) Ry(pitch) Rx(roll)."""
    x, y, z = np.eye(3)
    return np.asarray(_about(z, rpy[2]) @ _about(y, rpy[1]) @ _about(x, rpy[0]))


def _angles(rotation: Array) -> Array:
    """Return roll, pitch and yaw of a rotation; at a pitch of a right angle, where they merge, yaw is 0."""
    cosine = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], cosine))
    if cosine < 1e-9:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])


def _is_lost(label: str, dynamics: Dynamics, inertias: FullInertias) -> bool:
    name, _, joint = label.partition("@")
    return name == "rotor_inertia" and bool(inertias.rotors[dynamics.model.robot.joint_index(joint)])


def _notes(dynamics: Dynamics, inertias: FullInertias, locked: dict[str, float]) -> tuple[str, ...]:
    robot = dynamics.model.robot
    notes = []
    rotors = [f"{joint} {rotor:.6g}" for joint, rotor in zip(robot.joints, inertias.rotors, strict=True) if rotor]
    if rotors:
        notes.append(
            f"URDF knows no rotor inertia: {', '.join(rotors)} kg m^2 are not in the file"
            " (Pinocchio: model.armature; MuJoCo: armature)"
        )
    if locked:
        notes.append(f"fixed in this file: {', '.join(f'{name} at {at:g}' for name, at in locked.items())}")
    gravity = np.array(robot.rigid.model.gravity.linear)
    if np.abs(gravity - _GRAVITY).max() > 1e-9:
        notes.append(f"gravity {np.round(gravity, 6).tolist()} m/s^2 is not in the file: mount the base accordingly")
    notes.append(CHOICE)
    return tuple(notes)
