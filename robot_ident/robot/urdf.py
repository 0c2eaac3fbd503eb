"""A URDF as Pinocchio takes it, the joints, masses and meshes that it names, and the packages in which those lie."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError, did_you_mean

ENDLESS = 1e9  # rad, the limit that stands for none
_NO_DIRECTION = 1e-6  # length of an axis
_LONGEST = 20.0  # m; no arm has a link as long
_LONG = 5.0  # m; few arms have, and then their other links are not much shorter
_BEYOND = 20.0  # times the middle one of a robot's lengths
_TURN = 6.29  # rad; an angle beyond a turn is one in degrees
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
                if told is not None and key == "rpy" and max(abs(float(word)) for word in told.split()) > _TURN:
                    where = f"{path}: {branch.tag} {branch.get('name', '')!r}: <{element.tag} {key}={told[:60]!r}>"
                    raise InputError(f"{where}: radians were expected, and these are degrees")
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


def followed(text: str, moving: Collection[str]) -> dict[str, str]:
    """Return the joints that stand still in a model, by name, though they follow (mimic) one that moves: the leader of
    each, through others that follow.
    """
    leaders = {
        joint.get("name", ""): mimic.get("joint", "")
        for joint in ElementTree.fromstring(text).iter("joint")
        if (mimic := joint.find("mimic")) is not None
    }
    out = {}
    for name in leaders:
        leader, seen = leaders[name], {name}
        while leader in leaders and leader not in seen:
            seen.add(leader)
            leader = leaders[leader]
        if leader in moving:
            out[name] = leader
    return out


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


MOVING_KINDS = ("revolute", "continuous", "prismatic")
_GRIPPER = re.compile(r"gripper|finger|thumb|knuckle|(^|_)jaw", re.IGNORECASE)
_XACRO = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}", "{http://wiki.ros.org/xacro}")
_HAND = 3  # branches that move, from which on a link after an arm is taken for a hand's palm,
_ARM = 3  # an arm being so many joints or more
_STROKE = 0.15  # m; a slide shorter than this at the end of turning joints is taken for a gripper's


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF; limits None where the URDF gives none (a velocity or effort that isn't a finite number above 0
    counts as none).

    reversed: the lower and upper position limit of one whose lower is above its upper, None elsewhere. mimic: the joint
    that it follows, "" for none. gear_ratio: of its transmission, None without.
    """

    name: str
    kind: str
    parent: str
    child: str
    position: tuple[float, float] | None
    velocity: float | None
    effort: float | None
    mimic: str
    gear_ratio: float | None
    reversed: tuple[float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether it can move by itself."""
        return self.kind in MOVING_KINDS and not self.mimic


@dataclass(frozen=True)
class Inventory:
    """The joints of a URDF in the order of the file, and the chain of those that move."""

    robot: str
    joints: tuple[UrdfJoint, ...]
    tip: str

    def of_kind(self, *kinds: str) -> tuple[str, ...]:
        """Return the names of the joints of these kinds."""
        return tuple(joint.name for joint in self.joints if joint.kind in kinds and not joint.mimic)

    @property
    def mimics(self) -> Mapping[str, str]:
        """The joints that follow another, and which."""
        return {joint.name: joint.mimic for joint in self.joints if joint.mimic}

    @cached_property
    def chain(self) -> tuple[UrdfJoint, ...]:
        """The joints that move on the way from the base to the tip, without a gripper's at its end."""
        way: list[UrdfJoint] = []
        for joint in self._way:
            if len(way) >= _ARM and self._branches(joint.parent) >= _HAND:
                break
            way += [joint] if joint.moves else []
        while len(way) > 1 and self._is_gripper(way[-1], way[:-1]):
            way.pop()
        return tuple(way)

    @property
    def gripper(self) -> tuple[str, ...]:
        """The joints at the end of the way to the tip that look like a gripper's."""
        kept = {joint.name for joint in self.chain}
        return tuple(joint.name for joint in self._way if joint.moves and joint.name not in kept)

    @property
    def end_effector(self) -> str:
        """The link that the chain carries furthest out: below its last joint, by fixed joints alone."""
        below: dict[str, list[str]] = {}
        for joint in self.joints:
            if joint.kind == "fixed":
                below.setdefault(joint.parent, []).append(joint.child)
        level = [self.chain[-1].child]
        while deeper := [child for link in level for child in below.get(link, []) if not _GRIPPER.search(child)]:
            level = deeper
        return level[0]

    @property
    def _way(self) -> tuple[UrdfJoint, ...]:
        by_child = {joint.child: joint for joint in self.joints}
        way, link = [], self.tip
        while link in by_child:
            way.append(by_child[link])
            link = by_child[link].parent
        return tuple(reversed(way))

    def _branches(self, link: str) -> int:
        """Return in how many ways joints that move go on from a link."""
        return sum(joint.name in self._moving for joint in self.joints if joint.parent == link)

    @cached_property
    def _moving(self) -> frozenset[str]:
        """The joints that move, and those that lead to one."""
        by_child = {joint.child: joint for joint in self.joints}
        found: set[str] = set()
        for joint in self.joints:
            above: UrdfJoint | None = joint if joint.moves else None
            while above is not None and above.name not in found:
                found.add(above.name)
                above = by_child.get(above.parent)
        return frozenset(found)

    def _is_gripper(self, joint: UrdfJoint, before: list[UrdfJoint]) -> bool:
        """Return whether a last joint looks like a gripper's: by what follows it, by its name, or by a short slide."""
        if joint.name in self.mimics.values() or _GRIPPER.search(joint.name):
            return True
        stroke = joint.position[1] - joint.position[0] if joint.position else _STROKE
        return joint.kind == "prismatic" and stroke < _STROKE and all(j.kind != "prismatic" for j in before)


def read_inventory(text: str, source: Path | str, wanted: Collection[str] = ()) -> Inventory:
    """Return what a URDF holds. The tip is the link that most joints lead to, of those named in `wanted` if any.

    Raises InputError that names `source` where this is no URDF or nothing in it moves.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(f"{source}: not a URDF ({error})") from error
    if root.tag != "robot":
        raise InputError(f"{source}: not a URDF: its first element is <{root.tag}>, <robot> was expected")
    if any(element.tag.startswith(_XACRO) for element in root.iter()):
        raise InputError(f"{source}: is a xacro file; give its output (xacro {source} > robot.urdf)")
    ratios = _gear_ratios(root)
    joints = tuple(_joint(element, ratios, source) for element in root.findall("joint"))
    _require_tree(joints, source)
    if not any(joint.moves for joint in joints):
        raise InputError(f"{source}: no joint in it moves")
    return Inventory(root.get("name", ""), joints, _tip(joints, set(wanted)))


def _joint(element: ElementTree.Element, ratios: Mapping[str, float], source: Path | str) -> UrdfJoint:
    name = element.get("name", "")
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise InputError(f"{source}: joint {name!r} lacks a parent or a child link")
    limit, mimic = element.find("limit"), element.find("mimic")
    kind = element.get("type", "")
    numbers = {} if limit is None else {key: _number(limit, key, name, source) for key in limit.attrib}
    lower, upper = numbers.get("lower", 0.0), numbers.get("upper", 0.0)
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=parent.get("link", ""),
        child=child.get("link", ""),
        position=(lower, upper) if kind != "continuous" and lower < upper and isfinite(upper - lower) else None,
        velocity=_limit(numbers.get("velocity", 0.0)),
        effort=_limit(numbers.get("effort", 0.0)),
        mimic="" if mimic is None else mimic.get("joint", "?"),
        gear_ratio=ratios.get(name),
        reversed=(lower, upper) if kind != "continuous" and lower > upper else None,
    )


def _require_tree(joints: tuple[UrdfJoint, ...], source: Path | str) -> None:
    """Raise InputError where joints lack a name or share one, where a link hangs on two, or where they close a loop."""
    names, by_child = set[str](), dict[str, UrdfJoint]()
    for joint in joints:
        for what, name in (("joint", joint.name), ("parent link of a joint", joint.parent), ("child", joint.child)):
            if not name:
                raise InputError(
                    f"{source}: a {what} has no name ({joint.name!r}: {joint.parent!r} to {joint.child!r})"
                )
        if joint.name in names:
            raise InputError(f"{source}: two joints are called {joint.name!r}")
        if joint.child in by_child:
            other = by_child[joint.child].name
            raise InputError(f"{source}: link {joint.child!r} hangs on two joints, {other!r} and {joint.name!r}")
        names.add(joint.name)
        by_child[joint.child] = joint
    rooted: set[str] = set()
    for joint in joints:
        way, above = set[str](), by_child.get(joint.child)
        while above is not None and above.name not in rooted:
            if above.name in way:
                raise InputError(f"{source}: joint {above.name!r} is part of a loop; the joints of a URDF form a tree")
            way.add(above.name)
            above = by_child.get(above.parent)
        rooted |= way


def _limit(value: float) -> float | None:
    return value if isfinite(value) and value > 0.0 else None


def _number(element: ElementTree.Element, key: str, joint: str, source: Path | str) -> float:
    try:
        return float(element.get(key, ""))
    except ValueError as error:
        raise InputError(f"{source}: joint {joint!r}: limit {key} = {element.get(key)!r} is no number") from error


def _gear_ratios(root: ElementTree.Element) -> dict[str, float]:
    """Return the reductions of the URDF's transmissions by joint, leaving out the 1 that stands for "not known"."""
    out: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        joint = transmission.find("joint")
        reduction = transmission.find(".//mechanicalReduction")
        if joint is None or reduction is None or not reduction.text:
            continue
        try:
            ratio = abs(float(reduction.text))
        except ValueError:
            continue  # a word in an optional element says nothing about the ratio
        if ratio not in (0.0, 1.0):
            out[joint.get("name", "")] = ratio
    return out


def _tip(joints: tuple[UrdfJoint, ...], wanted: set[str]) -> str:
    """Return the deepest link below the most joints that move (and are wanted, where any are)."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    children = {joint.child for joint in joints}
    best, seen = ((-1, -1, 0), ""), 0
    waiting = [(link, 0, 0, 0) for link in below if link not in children]
    while waiting:
        link, named, count, depth = waiting.pop()
        seen += 1
        found = (named if wanted else count, count, depth)
        if found > best[0]:
            best = (found, link)
        for joint in below.get(link, []) if seen <= len(joints) + 1 else []:
            waiting.append((joint.child, named + (joint.name in wanted), count + joint.moves, depth + 1))
    return best[1]


def find_resource(name: str, folder: Path) -> Path | None:
    """Return the file that `package://PACKAGE/...`, `file://...` or a path relative to `folder` means, or None.

    A name that no file can have is None, too.
    """
    kind, _, rest = name.partition("://")
    if not rest:
        path = folder / name
        return path if os.path.isfile(path) else None
    if kind == "file":
        path = Path(unquote(urlparse(name).path))
        return path if os.path.isfile(path) else None
    return next((path for place in _places(folder) if os.path.isfile(path := place / rest)), None)


def _places(folder: Path) -> Iterator[Path]:
    """Yield the folders in which packages are looked for, the nearest first."""
    folder = folder.resolve()
    yield from (folder, *folder.parents)
    for path in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if path:
            yield from (Path(path), Path(path).parent)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share"
    for base in map(Path, sys.path):
        yield base / "cmeel.prefix" / "share"  # where the wheels of the Pinocchio project put their robots
    yield Path(sys.prefix) / "share"
