"""Moves chosen and ordered from an approved list: a tour between approved poses that tells most for its time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from robot_ident.configuration import Closed, read, schema
from robot_ident.design.criteria import Evaluation, evaluate_rows, unidentifiable
from robot_ident.design.target import Target
from robot_ident.errors import InputError, did_you_mean
from robot_ident.limits.certifier import Certifier, Margins
from robot_ident.limits.feasibility import require_limits
from robot_ident.planning.validation_motion import moves
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.point_to_point import LAWS, LONGEST_PAUSE, PointToPoint

PACES = (1.0, 0.6, 0.35)  # shares of the speed that a move may use: friction shows in how torque changes with it
_RIDGE = 1e-9  # of a column's largest information: keeps a tour that tells not all parameters comparable with others
_ALIKE = 1e-4  # rad or m: no move at all
_ROUNDS = 2500  # proposals of the annealing, times the number of starts
_STARTS = 3


@dataclass(frozen=True)
class Waypoints:
    """Approved poses [rad, m] of joints by name, and the straight moves between them that are approved."""

    joints: tuple[str, ...]
    poses: Mapping[str, Array]
    moves: tuple[tuple[str, str], ...]
    law: str
    pause: float

    @classmethod
    def read(cls, path: Path | str, robot: Robot) -> Waypoints:
        """Read a list of waypoints for a robot; InputError lists every problem with its field and value."""
        file = read(WaypointsFile, path)
        wrong = []
        if set(file.joints) != set(robot.joints):
            wrong.append(f"joints = {', '.join(file.joints)}: those of {robot.name} are {', '.join(robot.joints)}")
        if file.law not in LAWS:
            wrong.append(f"law = {file.law!r}{did_you_mean(file.law, LAWS)}")
        for name, pose in file.poses.items():
            if len(pose) != len(file.joints):
                wrong.append(f"poses.{name} has {len(pose)} numbers for {len(file.joints)} joints")
        names = list(file.poses)
        for place, move in enumerate(file.moves or []):
            wrong += [f"moves.{place}: {word!r}{did_you_mean(word, names)}" for word in move if word not in names]
        if wrong:
            raise InputError(f"{path}: {'; '.join(wrong)}")
        order = [file.joints.index(name) for name in robot.joints]
        pairs = file.moves if file.moves is not None else [(a, b) for a in names for b in names if a != b]
        return cls(
            robot.joints,
            {name: np.array(pose, dtype=float)[order] for name, pose in file.poses.items()},
            tuple(dict.fromkeys((a, b) for a, b in pairs if a != b)),
            file.law,
            file.pause,
        )


class WaypointsFile(Closed):
    """Approved poses and moves in a YAML file."""

    schema_: schema("robot_ident/waypoints/1") = Field(alias="schema", description="what this file is")  # type: ignore[valid-type]
    joints: list[str] = Field(min_length=1, description="joints, in the order of the numbers of a pose")
    poses: dict[str, list[float]] = Field(min_length=2, description="approved poses by name, rad or m")
    moves: list[tuple[str, str]] | None = Field(
        None, description="approved straight moves [from, to]; default: between any two poses"
    )
    law: str = Field("smooth", description="smooth: without jumps of acceleration; fastest: trapezoid of the speed")
    pause: float = Field(0.3, ge=0, le=LONGEST_PAUSE, description="rest at each pose, s")


@dataclass(frozen=True)
class Tour:
    """A closed tour of moves, repeated as often as asked.

    names [K + 1]: its poses, the first one last again; paces [K]. cycle: one tour; motion: all of them. evaluation: of
    the mean of the repetitions. unidentifiable: parameters that no sequence of these moves tells apart. resting: joints
    that never move.
    """

    names: tuple[str, ...]
    paces: tuple[float, ...]
    cycle: PointToPoint
    motion: PointToPoint
    evaluation: Evaluation
    margins: Margins
    refused: tuple[tuple[str, str], ...]
    unidentifiable: tuple[str, ...] = ()
    resting: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Leg:
    """A certified move at a pace: its ends, the information [p, p] that it gives, how long it takes [s], its rows."""

    start: str
    goal: str
    pace: float
    information: Array
    seconds: float
    rows: Array


def plan_tour(
    target: Target,
    waypoints: Waypoints,
    *,
    length: int = 12,
    repeats: int = 8,
    sample_rate: float = 150.0,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Tour:
    """Return the closed tour of at most `length` approved moves whose information per second is largest: log det (sum
    of F' S^-1 F) - p log (duration), found by annealing.

    Only moves that keep every limit, certified over continuous time, are taken, at full speed or slower. Raises
    InputError where the approved moves form no closed tour.
    """
    robot, certifier = target.robot, Certifier(target.robot)
    require_limits(robot)
    legs, refused = _legs(target, waypoints, certifier, sample_rate)
    if not legs:
        raise InputError(
            f"--waypoints: no approved move keeps the robot's limits at any speed{_outside(waypoints, robot)}"
        )
    best = _annealed(legs, length, len(target.structure.parameters), seed, progress)
    points = np.array([waypoints.poses[leg.start] for leg in best] + [waypoints.poses[best[0].start]])
    paces = np.array([leg.pace for leg in best])
    cycle = moves(robot, points, law=waypoints.law, pause=waypoints.pause, pace=paces)
    again = np.concatenate([np.tile(points[:-1], (repeats, 1)), points[:1]])
    motion = replace(cycle, points=again, pace=np.tile(paces, repeats), seed=seed)
    rows = np.concatenate([leg.rows for leg in best]) * np.sqrt(repeats)
    names = (*(leg.start for leg in best), best[0].start)
    open_ = unidentifiable(rows)
    return Tour(
        names,
        tuple(paces.tolist()),
        cycle,
        motion,
        evaluate_rows(rows),
        certifier.margins(cycle),
        refused,
        tuple(name for name, is_open in zip(target.structure.names, open_, strict=True) if is_open),
        tuple(name for name, reach in zip(robot.joints, np.ptp(points, axis=0), strict=True) if reach == 0.0),
    )


def _outside(waypoints: Waypoints, robot: Robot) -> str:
    """Return why no move is left: poses that are alike, or the first one beyond a joint's limits, in words."""
    if all(np.abs(waypoints.poses[a] - waypoints.poses[b]).max() < _ALIKE for a, b in waypoints.moves):
        return ": the poses that they join are alike"
    for name, pose in waypoints.poses.items():
        for joint, angle, lower, upper in zip(robot.joints, pose, robot.limits.lower, robot.limits.upper, strict=True):
            if not lower <= angle <= upper:
                return f": poses.{name}: {joint} = {angle:g} is not within {lower:g} to {upper:g} (rad or m)"
    return ""


def _legs(
    target: Target, waypoints: Waypoints, certifier: Certifier, sample_rate: float
) -> tuple[list[_Leg], tuple[tuple[str, str], ...]]:
    """Return every approved move that is certified, at the paces at which it is, and those that are not."""
    legs: list[_Leg] = []
    refused = []
    for start, goal in waypoints.moves:
        pair = np.array([waypoints.poses[start], waypoints.poses[goal]])
        kept = []
        if np.abs(pair[1] - pair[0]).max() < _ALIKE:
            continue
        for pace in PACES:
            move = moves(target.robot, pair, law=waypoints.law, pace=np.array([pace]))
            if move.duration > 0.5 / sample_rate and certifier.keeps(move):
                kept.append((pace, move))
        if not kept:
            refused.append((start, goal))
        for pace, move in kept:
            t = np.arange(0.5 / sample_rate, move.duration, 1.0 / sample_rate)
            rows = target.weighted(move.reference(t), target.torque_variance)
            legs.append(_Leg(start, goal, pace, rows.T @ rows, move.duration + waypoints.pause, rows))
    return legs, tuple(refused)


def _annealed(
    legs: list[_Leg], length: int, parameters: int, seed: int, progress: Callable[[float], None] | None
) -> list[_Leg]:
    """Return the best closed tour by annealing, which replaces stretches of it by other ways between their ends."""
    rng = np.random.default_rng(seed)
    leaving: dict[str, list[_Leg]] = {}
    for leg in legs:
        leaving.setdefault(leg.start, []).append(leg)
    ways = _Ways(leaving)
    total = np.sum([leg.information for leg in legs], axis=0)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    unit, ridge = np.outer(scale, scale), _RIDGE * np.eye(parameters)

    def value(tour: list[_Leg]) -> float:
        """Return log det of a tour's information less p log of its duration."""
        information = np.sum([leg.information for leg in tour], axis=0) / unit + ridge
        return float(np.linalg.slogdet(information)[1] - parameters * np.log(sum(leg.seconds for leg in tour)))

    best: tuple[float, list[_Leg]] = -np.inf, []
    for start in range(_STARTS):
        tour = ways.closed(length, rng)
        if tour is None:
            break
        now = value(tour)
        for step in range(_ROUNDS):
            other = ways.changed(tour, length, rng)
            then = value(other)
            heat = 0.3 * parameters * (1.0 - step / _ROUNDS) ** 3 * 0.1
            if then > now or rng.random() < np.exp((then - now) / max(heat, 1e-9)):
                tour, now = other, then
            if now > best[0]:
                best = now, tour
            if progress is not None and step % 200 == 0:
                progress((start + step / _ROUNDS) / _STARTS)
    if not best[1]:
        raise InputError(
            "--waypoints: the approved moves that keep the robot's limits form no closed tour; approve a way back"
        )
    return best[1]


class _Ways:
    """Ways over approved moves from one pose to another."""

    def __init__(self, leaving: Mapping[str, list[_Leg]]) -> None:
        self._leaving = leaving

    def closed(self, length: int, rng: np.random.Generator) -> list[_Leg] | None:
        """Return a random closed tour, None where there is none."""
        for start in rng.permutation(sorted(self._leaving)).tolist():
            for _ in range(50):
                way = self._way(start, start, int(rng.integers(2, max(3, length + 1))), rng)
                if way:
                    return way
        return None

    def changed(self, tour: list[_Leg], length: int, rng: np.random.Generator) -> list[_Leg]:
        """Return the tour with one move at another pace, or another way for a stretch; itself where there is none."""
        place = int(rng.integers(len(tour)))
        if rng.random() < 0.3:
            leg = tour[place]
            same = [other for other in self._leaving[leg.start] if other.goal == leg.goal]
            return [*tour[:place], same[int(rng.integers(len(same)))], *tour[place + 1 :]]
        turned = [*tour[place:], *tour[:place]]  # a closed tour may begin anywhere
        cut = int(rng.integers(0, min(len(turned), 4) + 1))
        room = length - (len(turned) - cut)
        if room < 1:
            return tour
        end = turned[cut].start if cut < len(turned) else turned[0].start
        way = self._way(turned[0].start, end, int(rng.integers(1, min(room, cut + 2) + 1)), rng)
        return tour if way is None else [*way, *turned[cut:]]

    def _way(self, start: str, end: str, steps: int, rng: np.random.Generator) -> list[_Leg] | None:
        """Return a random way of so many moves, None where it leads elsewhere."""
        out: list[_Leg] = []
        place = start
        for left in range(steps, 0, -1):
            options = self._leaving.get(place, [])
            if left == 1:
                options = [leg for leg in options if leg.goal == end]
            if not options:
                return None
            out.append(options[int(rng.integers(len(options)))])
            place = out[-1].goal
        return out
