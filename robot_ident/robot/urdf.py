"""URDF text as a Pinocchio model of the joints that move."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError, did_you_mean

ENDLESS = 1e9  # rad, the limit that stands for none
_NO_DIRECTION = 1e-6  # length of an axis
_LONGEST = 20.0  # m; no arm has a link as long
_LONG = 5.0  # m; few arms have, and then their other links are not much shorter
_BEYOND = 20.0  # times the middle one of a robot's lengths
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "mesh": {"scale": 3},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "inertia": {key: 1 for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")},
}
_NEVER_NEGATIVE = ("value", "ixx", "iyy", "izz")  # of a link's mass and inertia


def parse_urdf(text: str, path: Path) -> Any:
    """Return the Pinocchio model of a URDF; InputError that names `path` when it can't be used."""
    import pinocchio

    try:
        _check_numbers(ElementTree.fromstring(text), path)
        with quiet():
            return pinocchio.buildModelFromXML(prepared(text))
    except (ValueError, RuntimeError, ElementTree.ParseError) as error:
        raise InputError(f"{path}: not a URDF that can be used ({str(error).splitlines()[0]})") from error


def _check_numbers(tree: ElementTree.Element, path: Path) -> None:
    """Raise InputError where a number is none, or an axis has no direction: Pinocchio takes both."""
    for branch in (*tree.findall("link"), *tree.findall("joint")):
        for element in branch.iter():
            for key, count in _NUMBERS.get(element.tag, {}).items():
                told = element.get(key)
                if told is not None and not _are_numbers(told, count):
                    where = f"{path}: {branch.tag} {branch.get('name', '')!r}: <{element.tag} {key}={told[:60]!r}>"
                    raise InputError(f"{where}: {count} numbers of a possible size were expected")
                if told is not None and key in _NEVER_NEGATIVE and float(told) < 0.0:
                    what = "a mass" if key == "value" else "a moment of inertia"
                    where = f"{path}: {branch.tag} {branch.get('name', '')!r}: <{element.tag} {key}={told[:60]!r}>"
                    raise InputError(f"{where}: {what} is never negative")
    for joint in tree.findall("joint"):
        axis = joint.find("axis")
        told = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
        moves = joint.get("type") in ("revolute", "continuous", "prismatic", "planar")
        if moves and max(abs(float(word)) for word in told.split()) < _NO_DIRECTION:
            raise InputError(f"{path}: joint {joint.get('name', '')!r}: the axis {told!r} has no direction")


def refuse_millimetres(model: Any, path: Path) -> None:
    """Raise InputError where a length of a Pinocchio model is that of no arm, or far beyond its others."""
    named = list(model.names)
    lengths = {}
    for k in range(1, len(named)):
        inertia = model.inertias[k]
        gyration = (
            (max(np.linalg.eigvalsh(inertia.inertia).max(), 0.0) / inertia.mass) ** 0.5 if inertia.mass > 0 else 0.0
        )
        lengths[f"{named[k]} lies"] = (
            float(np.linalg.norm(model.jointPlacements[k].translation)),
            "from the joint before",
        )
        lengths[f"the centre of mass behind {named[k]} lies"] = (float(np.linalg.norm(inertia.lever)), "from it")
        lengths[f"the inertia behind {named[k]} is that of its mass"] = (gyration, "from its centre")
    sizes = [size for size, _ in lengths.values() if size > 0.0]
    usual = float(np.median(sizes)) if sizes else 0.0
    for what, (size, whence) in lengths.items():
        if size > _LONGEST or size > _LONG and size > _BEYOND * usual:
            raise InputError(
                f"{path}: {what} {size:.4g} m {whence}: a length in millimetres? URDF has metres, kg and kg m^2"
            )


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(abs(value) <= ENDLESS for value in values)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the parsers' own lines off standard error: our one line says what is wrong."""
    sys.stderr.flush()
    kept = os.dup(2)
    nothing = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def refuse_mimics(text: str, moving: Iterable[str], path: Path) -> None:
    """Raise InputError where a joint that mimics another is to move by itself."""
    names = set(moving)
    for joint in ElementTree.fromstring(text).iter("joint"):
        if joint.find("mimic") is not None and joint.get("name", "") in names:
            raise InputError(
                f"{path}: joint {joint.get('name')!r} mimics another; lock it under 'locked' in a robot YAML"
            )


def endless(text: str) -> str:
    """Return the URDF with continuous joints as revolute ones without a position limit: one number then tells their
    angle.
    """
    if '"continuous"' not in text:
        return text
    tree = ElementTree.fromstring(text)
    for joint in tree.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ElementTree.SubElement(joint, "limit", {"velocity": "0", "effort": "0"})
            limit.set("lower", str(-ENDLESS))
            limit.set("upper", str(ENDLESS))
    return ElementTree.tostring(tree, encoding="unicode")


def prepared(text: str) -> str:
    """Return the URDF as Pinocchio takes it: see `endless`; links that bear the name of a joint are renamed."""
    return _apart(endless(text))


def _apart(text: str) -> str:
    """Return the URDF with links renamed that bear the name of a joint, which Pinocchio can't tell apart."""
    tree = ElementTree.fromstring(text)
    joints = {joint.get("name") for joint in tree.findall("joint")}
    both = {name: f"{name}_link" for link in tree.findall("link") if (name := link.get("name", "")) in joints}
    if not both:
        return text
    for element in (*tree.findall("link"), *tree.findall("joint/parent"), *tree.findall("joint/child")):
        key = "name" if element.tag == "link" else "link"
        element.set(key, both.get(element.get(key, ""), element.get(key, "")))
    return ElementTree.tostring(tree, encoding="unicode")


def lock(model: Any, moving: Iterable[str], angles: Mapping[str, float], path: Path) -> Any:
    """Return the model with every joint that isn't moving held at its angle (0 unless told)."""
    import pinocchio

    names = list(model.names)[1:]
    for word in (*moving, *angles):
        if word not in names:
            raise InputError(f"{path}: joint {word!r} is not in the URDF{did_you_mean(word, names)}")
    held, q = _held(model, moving, angles)
    return pinocchio.buildReducedModel(model, held, q) if held else model


def lock_geometry(model: Any, geometry: Any, moving: Iterable[str], angles: Mapping[str, float]) -> Any:
    """Return the geometry of a model after `lock`."""
    import pinocchio

    held, q = _held(model, moving, angles)
    return pinocchio.buildReducedModel(model, geometry, held, q)[1] if held else geometry


def _held(model: Any, moving: Iterable[str], angles: Mapping[str, float]) -> tuple[list[int], Any]:
    """Return the indices of the joints that are held, and the configuration at which they are."""
    import pinocchio

    kept, q = set(moving), pinocchio.neutral(model)
    for name, angle in angles.items():
        q[model.joints[model.getJointId(name)].idx_q] = angle
    return [model.getJointId(name) for name in list(model.names)[1:] if name not in kept], q


def check_serial(model: Any, path: Path) -> None:
    """Raise InputError unless the joints are revolute or prismatic ones in a chain."""
    for joint in range(1, model.njoints):
        kind = model.joints[joint].shortname()
        if model.joints[joint].nq != 1 or model.joints[joint].nv != 1 or "Mimic" in kind:
            raise InputError(
                f"{path}: joint {model.names[joint]!r} is of type {kind}; only revolute joints and prismatic"
                " ones can move (lock it in a robot YAML, or give it limits in the URDF)"
            )
        if model.parents[joint] != joint - 1:
            raise InputError(
                f"{path}: the joints branch at {model.names[joint]!r}; list one chain under 'joints' in a robot YAML"
            )
