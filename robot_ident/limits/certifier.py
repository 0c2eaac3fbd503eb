"""Certifies that a motion keeps a robot's limits at every time, not only at samples, and by how much."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.limits.feasibility import PoseLimits, joints_without_limit
from robot_ident.limits.self_collision import LinkPairs, keeps_apart, link_pairs, self_separation
from robot_ident.limits.workspace_distance import FrameKinematics, keeps_rule, workspace_margin
from robot_ident.robot.robot import Robot
from robot_ident.trajectories.excitation import Certifiable, Excitation, Piece
from robot_ident.trajectories.fourier_series import Extremes

if TYPE_CHECKING:
    from robot_ident.limits.torque_bound import TorqueRange


@dataclass(frozen=True)
class Margin:
    """How far a motion stays from a limit: `value` comes nearest at `time` [s].

    `where` is a joint, the text of a workspace rule or a pair of links; `relative` is the margin as a share of the
    limit (of one metre for a rule and for links); `proven` tells a bound over continuous time from one over samples.
    `margin` > 0: it is kept.
    """

    quantity: str
    where: str
    margin: float
    value: float
    limit: float
    time: float
    unit: str
    relative: float
    proven: bool = True

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, strictly."""
        return self.margin > 0.0

    @property
    def cells(self) -> tuple[str, ...]:
        """What tables show: limit, joint or rule, reached, allowed, margin, unit, time [s], proof or samples."""
        return (
            self.quantity.replace("_", "-"),
            self.where,
            f"{self.value:.5g}",
            f"{self.limit:.5g}",
            f"{self.margin:.3g}",
            self.unit,
            f"{self.time:.3f}",
            "proof" if self.proven else "samples",
        )

    def __str__(self) -> str:
        """Return the margin in words."""
        state, distance = "keeps" if self.kept else "breaks", f"{abs(self.margin):.3g} {self.unit}"
        if self.quantity == "workspace":
            return f"{state} the rule '{self.where}' by {distance} at t = {self.time:.3f} s"
        if self.quantity == "self_collision":
            apart = f"{self.value:.4g} m apart: that {state} the clearance of {self.limit:g} m"
            return f"links {self.where} come {apart} by {distance} at t = {self.time:.3f} s"
        what = f"{self.quantity} of {self.where}, {self.value:.6g} {self.unit},"
        return f"{what} {state} its limit {self.limit:g} {self.unit} by {distance} at t = {self.time:.3f} s"


@dataclass(frozen=True)
class Margins:
    """The tightest margin of every limit, what the robot's files don't tell, and what was left out on purpose."""

    items: tuple[Margin, ...]
    unknown: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether every limit is kept, strictly."""
        return all(item.kept for item in self.items)

    @property
    def not_checked(self) -> str:
        """What was not checked, as one line; empty where everything was."""
        return not_checked(self.unknown)

    @property
    def tightest(self) -> Margin | None:
        """The limit that comes nearest, relative to its size."""
        return min(self.items, key=lambda item: item.relative, default=None)

    @property
    def violations(self) -> tuple[Margin, ...]:
        """Limits that are not kept, the worst first."""
        return tuple(sorted((item for item in self.items if not item.kept), key=lambda item: item.relative))

    def to_json(self) -> dict[str, Any]:
        """Return the margins as plain values: by quantity and joint, rules of the workspace in a list."""
        out: dict[str, Any] = {"kept": self.kept, "position": {}, "velocity": {}, "acceleration": {}}
        for item in self.items:
            record = {key: getattr(item, key) for key in ("margin", "value", "limit", "time", "unit", "proven")}
            if item.quantity == "workspace":
                out.setdefault("workspace", []).append({"rule": item.where, **record})
            elif item.quantity == "self_collision":
                out["self_collision"] = {"links": item.where, **record}
            else:
                out.setdefault(item.quantity, {})[item.where] = record
        if self.unknown:
            out["unknown"] = list(self.unknown)
        if self.notes:
            out["notes"] = list(self.notes)
        return out


def not_checked(unknown: Iterable[str]) -> str:
    """Return what no certificate covers as one line; empty where there is nothing."""
    words = "; ".join(unknown)
    return f"not checked: {words}" if words else ""


def beyond_check(robot: Robot) -> list[str]:
    """Return what no check of a robot's motions sees, in words: what certificates don't speak of."""
    out = []
    if robot.workspace:
        out.append(
            f"surroundings other than the workspace rule, and any part of the arm but {robot.end_effector} there"
        )
    if not {"viscous", "coulomb"} & set(robot.simulation):
        out.append("friction in the torque (it counts as zero until the YAML's simulation gives it)")
    return out


def unchecked_refusal(unknown: Iterable[str], accept: str) -> str:
    """Return why a motion with something unchecked is refused, empty where all is checked; accept: what else to do."""
    line = not_checked(unknown)
    return f"{line}; write the facts into the robot YAML, or {accept}" if line else ""


def worst_of(parts: Iterable[Margins]) -> Margins:
    """Return the tightest margin of every limit over the parts of a motion."""
    parts = list(parts)
    items = tuple(min(same, key=lambda item: item.margin) for same in zip(*(part.items for part in parts), strict=True))
    return Margins(items, parts[0].unknown, parts[0].notes)


class Certifier:
    """Certifies motions of one robot over continuous time.

    Position, velocity and acceleration from the exact extremes; workspace rules, the distance between links and, where
    the robot's files give what it takes to compute it, the torque by interval subdivision with derivative bounds.
    """

    def __init__(self, robot: Robot) -> None:
        """Build the kinematics of the frames that the robot's rules name."""
        self._robot = robot
        self._kinematics = {rule.frame: FrameKinematics(robot, rule.frame) for rule in robot.workspace}

    def prepare(self) -> Certifier:
        """Make now whatever `keeps` needs without torques and `poses` need, and return self.

        Only one thread of a process may make CasADi expressions at a time: CasADi (3.8) lets go of Python's lock while
        it works, and keeps one table of constants for all; two threads at it end in a segmentation fault. Functions
        that are there may be evaluated by any thread. So a certifier for another thread is made and prepared before
        that thread runs; it is for that thread alone.
        """
        if self._links[0] is not None:
            self._links[0].prepare()
        return self

    @cached_property
    def unknown(self) -> tuple[str, ...]:
        """What no motion of the robot is checked for, in words: the robot's files don't give it."""
        robot = self._robot
        out = [f"{what} of {', '.join(names)}" for what, names in joints_without_limit(robot).items()]
        if not np.any(robot.rigid.parameters):
            out.append("torque (the URDF has no inertias)")
        return (*out, *self._links[1], *robot.unchecked)

    @cached_property
    def poses(self) -> PoseLimits:
        """What a pose of the robot has to keep."""
        return PoseLimits(self._robot, self._links[0])

    def margins(self, motion: Excitation | Certifiable) -> Margins:
        """Return the margins of a motion; InputError when it is of another robot."""
        return self._margins(_pieces(motion, self._robot))

    def parts(self, motion: Certifiable) -> dict[str, Margins]:
        """Return the margins of each part of a motion that has a name (see `Piece.name`)."""
        pieces = _pieces(motion, self._robot)
        names = dict.fromkeys(piece.name for piece in pieces)
        return {name: self._margins([piece for piece in pieces if piece.name == name]) for name in names}

    def _margins(self, pieces: Sequence[Piece]) -> Margins:
        items = _joint_margins(pieces, self._robot)
        items += self._workspace_margins(pieces) + self._link_margins(pieces) + self._torque_margins(pieces)
        links = self._links[0]
        unseen = [f"no limit here speaks of {what}" for what in beyond_check(self._robot)]
        return Margins(tuple(items), self.unknown, (*(() if links is None else links.shapes.notes), *unseen))

    def keeps(self, motion: Excitation | Certifiable, *, torque: bool = True) -> bool:
        """Return whether a motion keeps all limits, without the rest of the work once one is broken."""
        pieces = _pieces(motion, self._robot)
        if not Margins(tuple(_joint_margins(pieces, self._robot))).kept:
            return False
        rules = self._robot.workspace
        if not all(keeps_rule(rule, self._kinematics[rule.frame], piece) for rule in rules for piece in pieces):
            return False
        links = self._links[0]
        if links is not None and not all(keeps_apart(links, piece) for piece in pieces):
            return False
        return not torque or self._torque is None or all(self._torque.keeps(piece) for piece in pieces)

    @cached_property
    def _links(self) -> tuple[LinkPairs | None, list[str]]:
        return link_pairs(self._robot)

    @cached_property
    def _torque(self) -> TorqueRange | None:
        from robot_ident.limits.torque_bound import TorqueModel, TorqueRange

        model = TorqueModel(self._robot)
        return TorqueRange(model, self._robot.limits.torque) if model.known else None

    def _torque_margins(self, pieces: Sequence[Piece]) -> list[Margin]:
        if self._torque is None:
            return []
        found = [self._torque.extreme(piece) for piece in pieces]
        items, proven = [], all(extreme.proven for extreme in found)
        for joint in np.flatnonzero(np.isfinite(self._robot.limits.torque)).tolist():
            name, limit = self._robot.joints[joint], float(self._robot.limits.torque[joint])
            worst = max(found, key=lambda extreme: extreme.bound[joint])
            margin, unit = limit - float(worst.bound[joint]), self._robot.link_torque_unit(joint)
            value, time = float(worst.value[joint]), float(worst.time[joint])
            items.append(Margin("torque", name, margin, value, limit, time, unit, margin / limit, proven))
        return items

    def _link_margins(self, pieces: Sequence[Piece]) -> list[Margin]:
        links, geometry = self._links[0], self._robot.geometry
        if links is None or geometry is None or not links.count:
            return []
        worst = min((self_separation(links, piece) for piece in pieces), key=lambda found: found.lower)
        margin, name = worst.lower - geometry.clearance, links.name(worst.pair)
        return [Margin("self_collision", name, margin, worst.value, geometry.clearance, worst.time, "m", margin)]

    def _workspace_margins(self, pieces: Sequence[Piece]) -> list[Margin]:
        items = []
        for rule in self._robot.workspace:
            found = [workspace_margin(rule, self._kinematics[rule.frame], piece) for piece in pieces]
            worst = min(found, key=lambda minimum: minimum.lower)
            items.append(Margin("workspace", rule.text, worst.lower, worst.value, 0.0, worst.time, "m", worst.lower))
        return items


def certify(motion: Excitation | Certifiable, robot: Robot) -> Margins:
    """Return the margins of a motion over continuous time (see `Certifier`); InputError where it is another robot's."""
    return Certifier(robot).margins(motion)


def _pieces(motion: Excitation | Certifiable, robot: Robot) -> Sequence[Piece]:
    if isinstance(motion, Excitation):
        motion.check_robot(robot)
        series = motion.series
        return [Piece(0.0, series.period, series.motion, series.extremes(), series.jerk_bound())]
    if motion.joints != robot.joints:
        raise InputError(
            f"motion of another robot: joints {', '.join(motion.joints)}; robot {robot.name!r} has"
            f" {', '.join(robot.joints)}"
        )
    return motion.pieces()


def _joint_margins(pieces: Sequence[Piece], robot: Robot) -> list[Margin]:
    limits, items = robot.limits, []
    ranges = (
        ("position", "", limits.lower, limits.upper),
        ("velocity", "/s", -limits.velocity, limits.velocity),
        ("acceleration", "/s^2", -limits.acceleration, limits.acceleration),
    )
    for index, (quantity, rate, lower, upper) in enumerate(ranges):
        for joint in np.flatnonzero(np.isfinite(lower) & np.isfinite(upper)).tolist():
            low, high = float(lower[joint]), float(upper[joint])
            found = [_range_margin(piece.extremes[index], joint, low, high) for piece in pieces]
            margin, value, limit, time = min(found, key=lambda entry: entry[0])
            unit = ("m" if robot.prismatic[joint] else "rad") + rate
            relative = margin / (0.5 * (high - low))
            items.append(Margin(quantity, robot.joints[joint], margin, value, limit, time, unit, relative))
    return items


def _range_margin(extremes: Extremes, joint: int, lower: float, upper: float) -> tuple[float, float, float, float]:
    """Return (margin, value, limit, time) at the nearer of two limits."""
    low, high = float(extremes.lower[joint]), float(extremes.upper[joint])
    if low - lower < upper - high:
        return low - lower, low, lower, float(extremes.lower_time[joint])
    return upper - high, high, upper, float(extremes.upper_time[joint])
