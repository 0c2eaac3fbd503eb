"""What a URDF says about its joints, before it is decided which of them move."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from robot_ident.errors import InputError

MOVING_KINDS = ("revolute", "continuous", "prismatic")
_GRIPPER = re.compile(r"gripper|finger|thumb|knuckle|(^|_)jaw", re.IGNORECASE)
_HAND = 3  # branches that move, from which on a link after an arm is taken for a hand's palm,
_ARM = 3  # an arm being so many joints or more
_STROKE = 0.15  # m; a slide shorter than this at the end of turning joints is taken for a gripper's


@dataclass(frozen=True)
class UrdfJoint:
    """A joint of a URDF; limits None where the URDF gives none (zero velocity or effort counts as none).

    mimic: the joint that it follows, "" for none. gear_ratio: of its transmission, None without.
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

    @property
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
        below: dict[str, list[UrdfJoint]] = {}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)

        def moves(joint: UrdfJoint) -> bool:
            return joint.moves or any(moves(child) for child in below.get(joint.child, []))

        return sum(moves(joint) for joint in below.get(link, []))

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
    if any(element.tag.startswith("{http://www.ros.org/wiki/xacro}") for element in root.iter()):
        raise InputError(f"{source}: is a xacro file; give its output (xacro {source} > robot.urdf)")
    ratios = _gear_ratios(root)
    joints = tuple(_joint(element, ratios, source) for element in root.findall("joint"))
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
        position=(lower, upper) if kind != "continuous" and lower < upper else None,
        velocity=numbers.get("velocity") or None,
        effort=numbers.get("effort") or None,
        mimic="" if mimic is None else mimic.get("joint", "?"),
        gear_ratio=ratios.get(name),
    )


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
