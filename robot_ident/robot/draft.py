"""Drafts a robot YAML: every field with where its value comes from, and what is missing left for the user."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from robot_ident.configuration import load_yaml
from robot_ident.errors import InputError
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import robot_of
from robot_ident.robot.urdf import Inventory, UrdfJoint
from robot_ident.signals.motion import Array

GRAVITY = 9.81
MOUNTS: dict[str, tuple[float, float, float]] = {  # gravity in the base frame, m/s^2
    "floor": (0.0, 0.0, -GRAVITY),
    "ceiling": (0.0, 0.0, GRAVITY),
    "wall": (-GRAVITY, 0.0, 0.0),
}
_ROOM = 0.1  # m that the end effector has above the guessed plane where every joint is in its middle

_NO_INERTIA = 1e-9  # of the moments about the joint: what rounding leaves of zero


@dataclass(frozen=True)
class Evidence:
    """What a recording says of a robot: its joints, the mean position of each, noise variances of one sample (nan
    where unknown) and the smallest step of each position (0 where none shows), all [n] in the order of `joints`.
    """

    source: str
    joints: tuple[str, ...]
    position: Array
    torque_variance: Array
    position_variance: Array
    encoder_step: Array

    def of(self, joint: str, values: Array) -> float | None:
        """Return a joint's value, None where it isn't known."""
        if joint not in self.joints:
            return None
        value = float(values[self.joints.index(joint)])
        return value if value > 0 else None


@dataclass(frozen=True)
class Draft:
    """A robot YAML with the joints that move in it, those held, and what a person still has to look at."""

    text: str
    moving: tuple[str, ...]
    held: Mapping[str, str]
    guesses: tuple[str, ...]
    missing: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, but the text."""
        found = {"moving": list(self.moving), "held": dict(self.held)}
        return {**found, "guesses": list(self.guesses), "missing": list(self.missing)}


@dataclass
class _Page:
    """Lines of a YAML file, and what was guessed or left open in them."""

    lines: list[str] = field(default_factory=list)
    guesses: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def found(self, text: str, why: str = "") -> None:
        """Write a line whose value was found."""
        self.lines.append(f"{text}  # {why}" if why else text)

    def guess(self, text: str, why: str, of: str = "") -> None:
        """Write a line whose value is a guess; of: the joint that it belongs to, for who reads the guess alone."""
        self.lines.append(f"{text}  # GUESS: {why}")
        key, colon, value = text.strip().removeprefix("- ").partition(":")
        self.guesses.append(f"{key}{f' of {of}' if of else ''}{colon}{value}: {why}")

    def lacks(self, text: str, what: str, why: str) -> None:
        """Write, as a comment, a line that a person has to fill in."""
        self.lines.append(f"{text[: len(text) - len(text.lstrip())]}# {text.lstrip()}  # MISSING: {why}")
        self.missing.append(what)


def draft_robot(
    inventory: Inventory,
    urdf: str,
    *,
    name: str,
    mount: str | None = None,
    gravity: Sequence[float] | None = None,
    acceleration: Mapping[str, float] | None = None,
    held: Mapping[str, float] | None = None,
    evidence: Evidence | None = None,
    topic: str | None = None,
    height: float | None = None,
) -> Draft:
    """Return the draft of a robot YAML.

    urdf: as it shall stand in the file. gravity [3] m/s^2, or the mount that implies it; held: angles at which joints
    of the chain are locked; acceleration: limits by joint, rad/s^2. evidence: what a recording says; joints of the
    chain that it lacks are held. topic: of the joint states, where bags hold several. height: of the end
    effector along the base's z axis with every joint in the middle of its range, m.
    """
    told = dict(held or {})
    present = None if evidence is None else set(evidence.joints)
    moving = tuple(
        joint for joint in inventory.chain if joint.name not in told and (present is None or joint.name in present)
    )
    page = _Page()
    page.found("# Written by robot_ident init. GUESS: please check. MISSING: please fill in and take the # away.")
    page.found("schema: robot_ident/robot/1")
    page.found(f"name: {_quoted(name)}")
    page.found(f"urdf: {_quoted(urdf)}")
    page.guess(f"end_effector: {_quoted(inventory.end_effector)}", "the last link of the chain")
    _gravity(page, mount, gravity)
    page.guess(
        "effort: torque" if topic is None else f"effort: {{quantity: torque, topic: {json.dumps(topic)}}}",
        "Nm on the joint side; current where the driver reports ampere (info --robot tests it)",
    )
    page.found("")
    page.found("joints:")
    for joint in moving:
        _joint(page, joint, (acceleration or {}).get(joint.name), evidence)
    reasons = _held(page, inventory, {joint.name for joint in moving}, told, evidence)
    page.found("")
    _workspace(page, inventory.end_effector, mount, gravity, height)
    page.found("# further sections: springs, effects, anti_alias, self_collision (see docs/design.md)")
    names = tuple(joint.name for joint in moving)
    return Draft("\n".join(page.lines) + "\n", names, reasons, tuple(page.guesses), tuple(page.missing))


def _gravity(page: _Page, mount: str | None, gravity: Sequence[float] | None) -> None:
    vector = list(gravity or MOUNTS[mount or "floor"])
    text = f"gravity: [{', '.join(f'{value:g}' for value in vector)}]"
    if gravity is None and mount is None:
        page.guess(text, "the base stands level on the floor (else --mount or --gravity)")
    elif mount == "wall":
        page.guess(text, "the base's x axis points up the wall (else --gravity)")
    else:
        page.found(text, "as told")


def _workspace(
    page: _Page, frame: str, mount: str | None, gravity: Sequence[float] | None, height: float | None
) -> None:
    """Write the plane on which the base is mounted as the one thing that is known to be around the robot.

    The base's z axis leads away from it, on the floor, under the ceiling and on a wall. Where gravity points along
    another axis and no mount is given, nobody knows which way the plane lies.
    """
    upright = mount is not None or gravity is None or not any(gravity[:2])
    if not upright:
        page.lacks(
            "workspace: [{kind: half_space, normal: [X, Y, Z], offset: 0}]",
            "the floor: how the base stands on it",
            "normal: up, or away from what the base is mounted on; offset: m along it",
        )
        page.found("")
        return
    name = {"wall": "wall", "ceiling": "ceiling"}.get(mount or "", "ceiling" if gravity and gravity[2] > 0 else "floor")
    offset = 0.0 if height is None else min(0.0, round(height - _ROOM, 3))
    why = f"{frame} stays on the arm's side of the {name} that the base is mounted on"
    if offset < 0.0:
        why += (
            f"; {-offset:g} m beyond it, for {frame} is at {height:.3g} m with every joint in its middle: write what is"
            " really there"
        )
    page.found("workspace:  # what the robot could hit; check, then take guess: true away")
    page.guess(f"  - {{kind: half_space, normal: [0, 0, 1], offset: {offset:g}, guess: true}}", why)
    page.found("")


def _joint(page: _Page, joint: UrdfJoint, acceleration: float | None, evidence: Evidence | None) -> None:
    unit = "m" if joint.kind == "prismatic" else "rad"
    page.found(f"  {_quoted(joint.name)}:")
    limits: list[tuple[str, float | None, str]] = [
        ("velocity", joint.velocity, f"{unit}/s"),
        ("acceleration", acceleration, f"{unit}/s^2"),
        ("torque", joint.effort, "N" if unit == "m" else "Nm"),
    ]
    if joint.position is None:
        why = f"{unit}; the URDF sets no limit"
        if joint.reversed is not None:
            why = f"{unit}; the URDF's lower = {joint.reversed[0]:g} is above its upper = {joint.reversed[1]:g}"
        turned = ": the URDF's lower is above its upper" if joint.reversed is not None else ""
        page.lacks("    position: [LOWER, UPPER]", f"position limits of {joint.name}{turned}", why)
    else:
        page.found(f"    position: [{joint.position[0]:g}, {joint.position[1]:g}]", f"{unit}, URDF")
    for key, value, of in limits:
        if value is not None:
            page.found(f"    {key}: {value:g}", f"{of}, {'as told' if key == 'acceleration' else 'URDF'}")
        else:
            why = "a URDF has none; design needs it (data sheet, or --acceleration)" if key == "acceleration" else ""
            page.lacks(f"    {key}: VALUE", f"{key} limit of {joint.name}", f"{of}; {why or 'the URDF gives none'}")
    if joint.gear_ratio is not None:
        page.found(f"    gear_ratio: {joint.gear_ratio:g}", "URDF transmission")
    else:
        page.found("    # gear_ratio: VALUE", "optional: motor turns per turn; orders of torque_ripple count them")
    page.found("    # armature: VALUE", "optional: rotor inertia on the joint side, kg m^2")
    if evidence is None:
        return
    for key, values, of in (
        ("torque_variance", evidence.torque_variance, "of one sample"),
        ("position_variance", evidence.position_variance, "of one sample"),
    ):
        known = evidence.of(joint.name, values)
        if known is not None:
            page.found(f"    {key}: {known:.3g}", f"{of}, from the periods of {evidence.source}")
    step = evidence.of(joint.name, evidence.encoder_step)
    if step is not None:
        page.guess(f"    encoder_step: {step:.3g}", f"the smallest step in {evidence.source}", joint.name)


def _held(
    page: _Page, inventory: Inventory, moving: set[str], told: Mapping[str, float], evidence: Evidence | None
) -> dict[str, str]:
    """Write the joints that don't move; return why by name."""
    chain = {joint.name for joint in inventory.chain}
    rest = [joint for joint in inventory.joints if joint.kind in ("revolute", "continuous", "prismatic")]
    reasons: dict[str, str] = {}
    for joint in rest:
        if joint.name in moving:
            continue
        if not reasons:
            page.found("")
            page.found("locked:")
        if joint.name in told:
            reasons[joint.name] = "as told"
            page.found(f"  {_quoted(joint.name)}: {told[joint.name]:g}", "as told")
            continue
        low, high = joint.position or (0.0, 0.0)
        angle = min(max(0.0, low), high)
        if joint.mimic:
            why = f"follows {joint.mimic}"
        elif joint.name in inventory.gripper:
            why = "looks like a gripper"
        elif joint.name not in chain:
            why = "branches off the chain"
        else:
            why = f"{evidence.source if evidence else 'the recording'} has no such joint"
        if evidence is not None and joint.name in evidence.joints:
            angle = float(evidence.position[evidence.joints.index(joint.name)])
            why += f"; its mean position in {evidence.source}"
        reasons[joint.name] = why
        page.guess(f"  {_quoted(joint.name)}: {angle:.6g}", why)
    return reasons


def _quoted(text: str) -> str:
    """Return a YAML text: bare where it can't be mistaken for anything else, escaped where it would break the line."""
    plain = text.replace("_", "").replace("-", "").replace(".", "").replace("/", "")
    safe = plain.isalnum() and plain.isascii() and text[0].isalpha()
    if safe and text.lower() not in ("null", "true", "false", "yes", "no", "on", "off"):
        return text
    if not text.isprintable():
        return json.dumps(text)
    return "'" + text.replace("'", "''") + "'"


def height_of(draft: str, urdf: str, source: str) -> float | None:
    """Return where the end effector of a draft is along the base's z axis [m] with every joint in the middle of its
    range, None where the draft can't be used yet.
    """
    try:
        robot = robot_of(Definition(load_yaml(draft), urdf), source)
    except InputError:
        return None
    known = np.isfinite(robot.limits.lower) & np.isfinite(robot.limits.upper)
    middle = np.zeros(robot.n)
    middle[known] = 0.5 * (robot.limits.lower[known] + robot.limits.upper[known])
    return float(robot.rigid.frame_position(middle[None, :], robot.end_effector)[0, 2])


def weightless(robot: Robot) -> list[str]:
    """Return what the URDF lacks of the links that move: mass, or moments of inertia about the centre of mass."""
    out = []
    for joint, ten in zip(robot.joints, robot.rigid.parameters.reshape(-1, 10), strict=True):
        mass, first, moments = ten[0], ten[1:4], ten[[4, 6, 9]]
        about_centre = moments.sum() - 2.0 * first @ first / mass if mass > 0 else moments.sum()
        lacks = [] if mass > 0 else ["mass"]
        lacks += [] if about_centre > _NO_INERTIA * np.abs(moments).sum() else ["moments of inertia"]
        if lacks:
            out.append(f"{' and '.join(lacks)} of what {joint} moves: zero in the URDF")
    return out
