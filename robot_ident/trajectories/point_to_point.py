"""Motions from point to point with a full stop at each: straight in joint space, fast as limits allow or gently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from robot_ident.configuration import Closed, read, read_yaml, schema, to_yaml
from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import write_text
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion, frozen_array
from robot_ident.trajectories.excitation import SCHEMA as EXCITATION_SCHEMA
from robot_ident.trajectories.excitation import Excitation, Piece
from robot_ident.trajectories.fourier_series import Extremes, MotionExtremes

SCHEMA = "robot_ident/point_to_point/1"
LAWS = ("fastest", "smooth")
LONGEST_PAUSE = 3600.0  # s
_LONGEST = 86_400.0  # s; nobody lets a robot move for a day to validate a model
_STRICT = 1.0 - 1e-9  # share of the limits that a move may use
Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class PointToPoint:
    """Moves through points [K + 1, n] rad with a full stop and a pause [s] at each.

    On each move q = q_a + s(t) (q_b - q_a). Law `fastest`: s with the largest acceleration, then (where it is
    reached) the largest speed, then the largest deceleration (Swevers et al. 1997, section V: validation). Law
    `smooth`: s = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration, without a jump of acceleration. velocity, acceleration
    [n]: what each joint may use; pace [K]: share of the speed that a move uses.
    """

    robot: str
    joints: tuple[str, ...]
    points: Array
    velocity: Array
    acceleration: Array
    law: str = "fastest"
    pause: float = 0.0
    pace: Array = field(default_factory=lambda: np.zeros(0))
    seed: int | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and check that they agree; ValueError otherwise."""
        n = len(self.joints)
        object.__setattr__(self, "points", frozen_array(self.points, None, n))
        object.__setattr__(self, "velocity", frozen_array(self.velocity, n))
        object.__setattr__(self, "acceleration", frozen_array(self.acceleration, n))
        moves = len(self.points) - 1
        if moves < 1:
            raise ValueError(f"at least two points were expected, got {len(self.points)}")
        object.__setattr__(self, "pace", frozen_array(self.pace if len(self.pace) else np.ones(moves), moves))

    @cached_property
    def _profiles(self) -> list[tuple[float, float]]:
        return [self._profile(move) for move in range(len(self.points) - 1)]

    @cached_property
    def stops(self) -> Array:
        """When each move begins, and the end [K + 1] s: the motion rests there."""
        durations = np.array([duration for duration, _ in self._profiles])
        return np.concatenate([[0.0], np.cumsum(durations + self.pause)])

    def _profile(self, move: int) -> tuple[float, float]:
        """Return (duration, time of acceleration) [s] of a move."""
        distance = np.abs(self.points[move + 1] - self.points[move])
        if not np.any(distance > 0):
            return 0.0, 0.0
        pace = float(self.pace[move])
        with np.errstate(divide="ignore", over="ignore"):
            rate = _STRICT * pace * float(np.min(self.velocity / distance))
            bend = _STRICT * pace**2 * float(np.min(self.acceleration / distance))
        if not (rate > 0.0 and bend > 0.0):  # below the least of numbers
            return float("inf"), 0.0
        if self.law == "smooth":  # largest ds/du = 15/8, largest d2s/du2 = 10/sqrt(3)
            return max(1.875 / rate, float(np.sqrt(10.0 / np.sqrt(3.0) / bend))), 0.0
        rise = rate / bend
        if rise * rate >= 1.0:  # the largest speed isn't reached
            rise = float(np.sqrt(1.0 / bend))
            return 2.0 * rise, rise
        return rise + 1.0 / rate, rise

    @property
    def duration(self) -> float:
        """Duration with all pauses [s]."""
        return float(self.stops[-1])

    @property
    def start_pose(self) -> Array:
        """First point [n] rad."""
        return self.points[0]

    @property
    def end_pose(self) -> Array:
        """Last point [n] rad."""
        return self.points[-1]

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s; at rest before the start and after the end."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        move = np.clip(np.searchsorted(self.stops, t, side="right") - 1, 0, len(self.points) - 2)
        share = np.zeros((3, len(t)))
        for k in np.unique(move):
            rows = move == k
            share[:, rows] = self._share(int(k), t[rows] - self.stops[k])
        step = self.points[move + 1] - self.points[move]
        s, ds, dds = share[:, :, None]
        return Motion(self.points[move] + s * step, ds * step, dds * step)

    def _share(self, move: int, t: Array) -> Array:
        """Return s, ds/dt, d2s/dt2 [3, N] of a move, t [N] s after it begins."""
        duration, rise = self._profiles[move]
        if duration == 0.0:
            return np.vstack([np.ones_like(t), np.zeros_like(t), np.zeros_like(t)])
        return smooth_share(t, duration) if self.law == "smooth" else _trapezoid(t, duration, rise)

    def pieces(self) -> Sequence[Piece]:
        """Return the moves: each is monotone in every joint, so its ends and its largest rates bound it."""
        out = [self._piece(move) for move, (duration, _) in enumerate(self._profiles) if duration > 0.0]
        if not out:  # a motion that stays where it is
            zero = np.zeros(len(self.joints))
            still, q = _extremes(zero, zero, 0.0, 0.0), _extremes(self.points[0], self.points[0], 0.0, 0.0)
            out.append(Piece(0.0, max(self.duration, 1e-3), self.reference, MotionExtremes(q, still, still), zero))
        return out

    def _piece(self, move: int) -> Piece:
        a, b = self.points[move], self.points[move + 1]
        start, (duration, rise) = float(self.stops[move]), self._profiles[move]
        step, end, zero = b - a, start + duration, np.zeros(len(a))
        if self.law == "smooth":
            rate, bend = 1.875 / duration, 10.0 / np.sqrt(3.0) / duration**2
            early, late = (0.5 - np.sqrt(3.0) / 6.0) * duration, (0.5 + np.sqrt(3.0) / 6.0) * duration
        else:
            rate, bend = 1.0 / (duration - rise), 1.0 / (rise * (duration - rise))
            early, late = 0.5 * rise, duration - 0.5 * rise
        return Piece(
            start,
            end,
            self.reference,
            MotionExtremes(
                q=_extremes(a, b, start, end),
                dq=_extremes(zero, rate * step, start, start + 0.5 * duration),
                ddq=_extremes(bend * step, -bend * step, start + early, start + late),
            ),
            jerk=60.0 / duration**3 * np.abs(step) if self.law == "smooth" else zero,
            jumps=() if self.law == "smooth" else (start + rise, end - rise),
        )

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError when it is for another robot; those of the package with the same joints share motions."""
        if self.joints != robot.joints or (self.robot != robot.name and robot.definition is not None):
            raise InputError(
                f"motion of another robot: it is for {self.robot!r} with joints {', '.join(self.joints)};"
                f" robot {robot.name!r} has {', '.join(robot.joints)}"
            )

    def write(self, path: Path | str, *, force: bool = False) -> None:
        """Write the motion as YAML, whole or not at all; numbers are exact."""
        data = {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.joints),
            "law": self.law,
            "pause": float(self.pause),
            "velocity": self.velocity.tolist(),
            "acceleration": self.acceleration.tolist(),
            "pace": self.pace.tolist(),
            "points": self.points.tolist(),
        }
        write_text(path, to_yaml(data | ({} if self.seed is None else {"seed": self.seed})), force=force)

    @classmethod
    def read(cls, path: Path | str) -> PointToPoint:
        """Read a motion; InputError lists every problem with its field and value."""
        file = read(PointToPointFile, path)
        n = len(file.joints)
        lengths = {"velocity": len(file.velocity), "acceleration": len(file.acceleration)}
        lengths |= {f"points.{k}": len(point) for k, point in enumerate(file.points)}
        wrong = [f"{name} has {length} numbers for {n} joints" for name, length in lengths.items() if length != n]
        if file.law not in LAWS:
            wrong.append(f"law = {file.law!r}{did_you_mean(file.law, LAWS)}")
        if file.pace and len(file.pace) != len(file.points) - 1:
            wrong.append(f"pace has {len(file.pace)} numbers for {len(file.points) - 1} moves")
        if wrong:
            raise InputError(f"{path}: {'; '.join(wrong)}")
        motion = cls(
            file.robot,
            tuple(file.joints),
            np.array(file.points),
            np.array(file.velocity),
            np.array(file.acceleration),
            file.law,
            file.pause,
            np.array(file.pace),
            file.seed,
        )
        if not motion.duration < _LONGEST:
            raise InputError(
                f"{path}: it would take {motion.duration / 3600.0:.3g} hours; a speed, an acceleration or a pace is too"
                " small, or the pause too long"
            )
        return motion


class PointToPointFile(Closed):
    """A point-to-point motion in a YAML file."""

    schema_: schema(SCHEMA) = Field(alias="schema", description="what this file is")  # type: ignore[valid-type]
    robot: str = Field(description="name of the robot that it was made for")
    joints: list[str] = Field(min_length=1, description="joints that move, in the order of the chain")
    law: str = Field(
        "fastest", description="fastest: largest acceleration and speed; smooth: without jumps of acceleration"
    )
    pause: float = Field(0.0, ge=0, le=LONGEST_PAUSE, description="rest at each point, s")
    velocity: list[Positive] = Field(description="largest speed by joint, rad/s")
    acceleration: list[Positive] = Field(description="largest acceleration by joint, rad/s^2")
    pace: list[Annotated[float, Field(gt=0, le=1)]] = Field([], description="share of the speed that each move uses")
    points: list[list[float]] = Field(min_length=2, description="points in joint space, rad")
    seed: int | None = Field(None, description="seed of the random points")


def _extremes(first: Array, second: Array, first_time: float, second_time: float) -> Extremes:
    """Return the extremes of signals whose only candidates are two values at two times."""
    low, high = np.where(first > second, second_time, first_time), np.where(first > second, first_time, second_time)
    return Extremes(np.minimum(first, second), low, np.maximum(first, second), high)


def smooth_share(t: Array, duration: float) -> Array:
    """Return s, ds/dt, d2s/dt2 [3, N] of the quintic law s = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration."""
    u = np.clip(t / duration, 0.0, 1.0)
    return np.vstack(
        [
            u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
            30.0 * u**2 * (1.0 - u) ** 2 / duration,
            60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration**2,
        ]
    )


def _trapezoid(t: Array, duration: float, rise: float) -> Array:
    """Return s, ds/dt, d2s/dt2 [3, N] of the law with constant acceleration, constant speed, constant deceleration."""
    bend, rate = 1.0 / (rise * (duration - rise)), 1.0 / (duration - rise)
    left = np.clip(duration - t, 0.0, duration)
    t = np.clip(t, 0.0, duration)
    first, last = t < rise, left <= rise
    s = np.where(first, 0.5 * bend * t**2, np.where(last, 1.0 - 0.5 * bend * left**2, rate * (t - 0.5 * rise)))
    ds = np.where(first, bend * t, np.where(last, bend * left, rate))
    dds = np.where(first, bend, np.where(last, -bend, 0.0)) * ((t > 0.0) & (left > 0.0))
    return np.vstack([s, ds, dds])


def load_motion(path: Path | str) -> Excitation | PointToPoint:
    """Read an excitation or a point-to-point motion, told apart by the file's `schema`."""
    found = read_yaml(path).get("schema")
    if found == SCHEMA:
        return PointToPoint.read(path)
    if found == EXCITATION_SCHEMA:
        return Excitation.read(path)
    raise InputError(f"{path}: schema = {found!r}: a motion's is {EXCITATION_SCHEMA!r} or {SCHEMA!r}")
