"""What a URDF says about its joints, before it is decided which of them move."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree

from robot_ident.errors import InputError

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
