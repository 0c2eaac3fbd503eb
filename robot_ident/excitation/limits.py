"""Certifies that a motion keeps a robot's limits at every time, not only at samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import Extremes
from robot_ident.excitation.reference import Certifiable, Piece
from robot_ident.excitation.workspace_margin import FrameKinematics, keeps_rule, workspace_margin
from robot_ident.robot.robot import Robot

if TYPE_CHECKING:
    from robot_ident.excitation.torque import TorqueModel

_SAMPLES = 400  # of the torque along a piece


@dataclass(frozen=True)
class Margin:
    """How far a motion stays from a limit: `value` comes nearest at `time` [s].

    `where` is a joint or the text of a workspace rule; `relative` is the margin as a share of the limit (of one metre
    for a rule); `proven` tells a bound over continuous time from one over samples. `margin` > 0: it is kept.
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

    def __str__(self) -> str:
        """Return the margin in words."""
        state, distance = "keeps" if self.kept else "breaks", f"{abs(self.margin):.3g} {self.unit}"
        if self.quantity == "workspace":
            return f"{state} the rule '{self.where}' by {distance} at t = {self.time:.3f} s"
        what = f"{self.quantity} of {self.where}, {self.value:.6g} {self.unit},"
        return f"{what} {state} its limit {self.limit:g} {self.unit} by {distance} at t = {self.time:.3f} s"


@dataclass(frozen=True)
class Margins:
    """The tightest margin of every limit, and limits that the robot doesn't give."""

    items: tuple[Margin, ...]
    unknown: tuple[str, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether every limit is kept, strictly."""
        return all(item.kept for item in self.items)

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
            else:
                out.setdefault(item.quantity, {})[item.where] = record
        if self.unknown:
            out["unknown"] = list(self.unknown)
        return out


class Certifier:
    """Certifies motions of one robot over continuous time.

    Position, velocity and acceleration from the exact extremes, workspace rules by interval subdivision with
    derivative bounds; torque, where the robot's files give what it takes to compute it, from samples.
    """

    def __init__(self, robot: Robot) -> None:
        """Build the kinematics of the frames that the robot's rules name."""
        self._robot = robot
        self._kinematics = {rule.frame: FrameKinematics(robot, rule.frame) for rule in robot.workspace}

    def margins(self, motion: Excitation | Certifiable) -> Margins:
        """Return the margins of a motion; InputError when it is of another robot."""
        pieces = _pieces(motion, self._robot)
        items, unknown = _joint_margins(pieces, self._robot)
        items += self._workspace_margins(pieces)
        items += self._torque_margins(pieces)
        return Margins(tuple(items), tuple(unknown))

    def keeps(self, motion: Excitation | Certifiable, *, torque: bool = True) -> bool:
        """Return whether a motion keeps all limits, without the rest of the work once one is broken."""
        pieces = _pieces(motion, self._robot)
        if not Margins(tuple(_joint_margins(pieces, self._robot)[0])).kept:
            return False
        rules = [(rule, self._kinematics[rule.frame]) for rule in self._robot.workspace]
        if not all(keeps_rule(rule, kinematics, piece) for rule, kinematics in rules for piece in pieces):
            return False
        return not torque or Margins(tuple(self._torque_margins(pieces))).kept

    @cached_property
    def _torque(self) -> TorqueModel:
        from robot_ident.excitation.torque import TorqueModel

        return TorqueModel(self._robot)

    def _torque_margins(self, pieces: Sequence[Piece]) -> list[Margin]:
        if not self._torque.known:
            return []
        limits, share = self._robot.limits.torque, max(20, _SAMPLES // len(pieces))
        t = [np.linspace(piece.start, piece.end, share) for piece in pieces]
        motions = [piece.motion(times) for piece, times in zip(pieces, t, strict=True)]
        torque = np.concatenate([self._torque.torque(motion) for motion in motions])
        times, rows = np.concatenate(t), np.argmax(np.abs(torque), axis=0)
        items = []
        for joint, (name, row) in enumerate(zip(self._robot.joints, rows, strict=True)):
            if np.isfinite(limits[joint]):
                value, limit, unit = float(torque[row, joint]), float(limits[joint]), self._robot.torque_unit(joint)
                margin, time = limit - abs(value), float(times[row])
                items.append(Margin("torque", name, margin, value, limit, time, unit, margin / limit, proven=False))
        return items

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
        return [Piece(0.0, series.period, series.motion, series.extremes())]
    if motion.joints != robot.joints:
        raise InputError(
            f"motion of another robot: joints {', '.join(motion.joints)}; robot {robot.name!r} has"
            f" {', '.join(robot.joints)}"
        )
    return motion.pieces()


def _joint_margins(pieces: Sequence[Piece], robot: Robot) -> tuple[list[Margin], list[str]]:
    limits, items, unknown = robot.limits, [], []
    ranges = {
        "position": (limits.lower, limits.upper),
        "velocity": (-limits.velocity, limits.velocity),
        "acceleration": (-limits.acceleration, limits.acceleration),
    }
    for (quantity, (lower, upper)), index in zip(ranges.items(), range(3), strict=True):
        for joint, name in enumerate(robot.joints):
            if not (np.isfinite(lower[joint]) and np.isfinite(upper[joint])):
                unknown.append(f"{quantity} of {name}")
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
    return items, unknown


def _range_margin(extremes: Extremes, joint: int, lower: float, upper: float) -> tuple[float, float, float, float]:
    """Return (margin, value, limit, time) at the nearer of two limits."""
    low, high = float(extremes.lower[joint]), float(extremes.upper[joint])
    if low - lower < upper - high:
        return low - lower, low, lower, float(extremes.lower_time[joint])
    return upper - high, high, upper, float(extremes.upper_time[joint])
