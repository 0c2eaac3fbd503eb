"""Certifies that a motion keeps a robot's limits at every time, not only at samples."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.feasibility import PoseLimits
from robot_ident.excitation.fourier import Extremes
from robot_ident.excitation.margins import Margin, Margins
from robot_ident.excitation.reference import Certifiable, Piece
from robot_ident.excitation.self_collision import LinkPairs, keeps_apart, link_pairs, self_separation
from robot_ident.excitation.workspace_margin import FrameKinematics, keeps_rule, workspace_margin
from robot_ident.robot.robot import Robot

if TYPE_CHECKING:
    from robot_ident.excitation.torque_margin import TorqueRange

__all__ = ["Certifier", "Margin", "Margins", "certify"]


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
        robot, limits = self._robot, self._robot.limits
        known = {
            "position": np.isfinite(limits.lower) & np.isfinite(limits.upper),
            "velocity": np.isfinite(limits.velocity),
            "acceleration": np.isfinite(limits.acceleration),
            "torque": np.isfinite(limits.torque),
        }
        missing = {
            what: [name for name, is_known in zip(robot.joints, of, strict=True) if not is_known]
            for what, of in known.items()
        }
        out = [f"{what} of {', '.join(names)}" for what, names in missing.items() if names]
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
        items += self._workspace_margins(pieces)
        items += self._link_margins(pieces)
        items += self._torque_margins(pieces)
        shapes = self._links[0].shapes if self._links[0] is not None else None
        return Margins(tuple(items), self.unknown, shapes.notes if shapes is not None else ())

    def keeps(self, motion: Excitation | Certifiable, *, torque: bool = True) -> bool:
        """Return whether a motion keeps all limits, without the rest of the work once one is broken."""
        pieces = _pieces(motion, self._robot)
        if not Margins(tuple(_joint_margins(pieces, self._robot))).kept:
            return False
        rules = [(rule, self._kinematics[rule.frame]) for rule in self._robot.workspace]
        if not all(keeps_rule(rule, kinematics, piece) for rule, kinematics in rules for piece in pieces):
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
        from robot_ident.excitation.torque import TorqueModel
        from robot_ident.excitation.torque_margin import TorqueRange

        model = TorqueModel(self._robot)
        return TorqueRange(model, self._robot.limits.torque) if model.known else None

    def _torque_margins(self, pieces: Sequence[Piece]) -> list[Margin]:
        if self._torque is None:
            return []
        found = [self._torque.extreme(piece) for piece in pieces]
        items = []
        for joint, name in enumerate(self._robot.joints):
            limit = float(self._robot.limits.torque[joint])
            if np.isfinite(limit):
                worst = max(found, key=lambda extreme: extreme.bound[joint])
                margin, unit = limit - float(worst.bound[joint]), self._robot.torque_unit(joint)
                value, time = float(worst.value[joint]), float(worst.time[joint])
                proven = all(extreme.proven for extreme in found)
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
            kinematics = self._kinematics[rule.frame]
            worst = min(
                (workspace_margin(rule, kinematics, piece) for piece in pieces), key=lambda minimum: minimum.lower
            )
            items.append(Margin("workspace", rule.text, worst.lower, worst.value, 0.0, worst.time, "m", worst.lower))
        return items


def certify(motion: Excitation | Certifiable, robot: Robot) -> Margins:
    """Return the margins of a motion over continuous time (see `Certifier`); InputError for the motion of another
    robot.
    """
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
    ranges = {
        "position": (limits.lower, limits.upper),
        "velocity": (-limits.velocity, limits.velocity),
        "acceleration": (-limits.acceleration, limits.acceleration),
    }
    for (quantity, (lower, upper)), index in zip(ranges.items(), range(3), strict=True):
        for joint, name in enumerate(robot.joints):
            if not (np.isfinite(lower[joint]) and np.isfinite(upper[joint])):
                continue
            found = [
                _range_margin(piece.extremes[index], joint, float(lower[joint]), float(upper[joint]))
                for piece in pieces
            ]
            nearest = min(found, key=lambda entry: entry[0])
            margin, value, limit, time = nearest
            unit = ("m" if robot.prismatic[joint] else "rad") + ("", "/s", "/s^2")[index]
            relative = margin / (0.5 * float(upper[joint] - lower[joint]))
            items.append(Margin(quantity, name, margin, value, limit, time, unit, relative))
    return items


def _range_margin(extremes: Extremes, joint: int, lower: float, upper: float) -> tuple[float, float, float, float]:
    """Return (margin, value, limit, time) at the nearer of two limits."""
    low, high = float(extremes.lower[joint]), float(extremes.upper[joint])
    if low - lower < upper - high:
        return low - lower, low, lower, float(extremes.lower_time[joint])
    return upper - high, high, upper, float(extremes.upper_time[joint])
