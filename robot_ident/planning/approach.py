"""Gentle motions from rest to rest, round what is forbidden."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robot_ident.errors import InputError
from robot_ident.limits.certifier import Certifier
from robot_ident.limits.feasibility import PoseLimits, require_limits
from robot_ident.planning.validation_motion import moves
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.trajectories.point_to_point import PointToPoint

SHARE = 0.3  # of velocity and acceleration limits that an approach uses
_NODES = 400
_STRIDE = 0.25  # longest branch of a tree, as a share of the position limits
_SHORTCUTS = 40


class NotWanted(InputError):
    """An approach was given up: it is not wanted any more."""


def approach(
    q_now: Array,
    q_goal: Array,
    robot: Robot,
    *,
    share: float = SHARE,
    seed: int = 0,
    certifier: Certifier | None = None,
    wanted: Callable[[], bool] = lambda: True,
) -> PointToPoint:
    """Return a certified motion from rest at q_now [n] to rest at q_goal [n], round what is forbidden.

    It uses a share of the velocity and acceleration limits and stops at every point. Raises InputError when one of
    the ends is outside the limits (named with its value), or when no way is found. certifier: the robot's, where one is
    at hand. wanted: asked before each move that is tried; NotWanted once it says no.
    """
    require_limits(robot)
    certifier = certifier or Certifier(robot)
    ends = np.asarray(q_now, dtype=float), np.asarray(q_goal, dtype=float)
    for words, q in zip(("the robot stands", "the goal is"), ends, strict=True):
        check_pose(robot, q, words, certifier.poses)

    def allowed(start: Array, goal: Array) -> bool:
        if not wanted():
            raise NotWanted("the approach was given up")
        return certifier.keeps(moves(robot, np.array([start, goal]), law="smooth", share=share), torque=False)

    way = [ends[0], ends[1]]
    if not allowed(*ends):
        way = _shorten(_connect(robot, ends, allowed, seed), allowed, seed)
    return moves(robot, np.array(way), law="smooth", share=share)


def check_pose(robot: Robot, q: Array, words: str, poses: PoseLimits) -> None:
    """Raise InputError, beginning with `words`, when a pose is not of the robot's joints [n] or outside its limits."""
    if q.shape != (robot.n,) or not np.all(np.isfinite(q)):
        raise InputError(f"{words} at {q.tolist()}: {robot.n} finite positions were expected")
    limits = robot.limits
    for joint, name in enumerate(robot.joints):
        unit = "m" if robot.prismatic[joint] else "rad"
        if not limits.lower[joint] < q[joint] < limits.upper[joint]:
            limit = limits.lower[joint] if q[joint] <= limits.lower[joint] else limits.upper[joint]
            raise InputError(
                f"{words} outside the limits: {name} at {q[joint]:.4g} {unit}, its limit is {limit:.4g} {unit}"
            )
    for limit, margin in enumerate(poses.margins(q[None, :])[0]):
        if margin <= 0.0:
            where = "outside the workspace" if limit < len(robot.workspace) else "in self-collision"
            raise InputError(f"{words} {where}: {poses.text(limit, q)} is broken by {-margin:.4g} m")


def _connect(
    robot: Robot, ends: tuple[Array, Array], allowed: Callable[[Array, Array], bool], seed: int
) -> list[Array]:
    """Return a way between two poses by two trees that grow towards each other (Kuffner and LaValle 2000)."""
    rng, limits = np.random.default_rng(seed), robot.limits
    size = limits.upper - limits.lower
    trees: list[list[tuple[Array, int]]] = [[(ends[0], -1)], [(ends[1], -1)]]
    for _ in range(_NODES):
        tree, other = trees
        target = limits.lower + size * rng.uniform(0.01, 0.99, robot.n)
        node = _grow(tree, target, size, allowed)
        if node is not None:
            reached = node
            while (met := _grow(other, tree[node][0], size, allowed)) is not None and met != reached:
                reached = met
                if np.array_equal(other[met][0], tree[node][0]):
                    first, second = _branch(tree, node), _branch(other, met)
                    way = [*reversed(first), *second[1:]]
                    return way if np.array_equal(way[0], ends[0]) else way[::-1]
        trees.reverse()
    raise InputError(
        f"{robot.name}: no way was found from {np.round(ends[0], 3).tolist()} to {np.round(ends[1], 3).tolist()} rad"
        " within the limits and the workspace; move the robot nearer by hand"
    )


def _grow(
    tree: list[tuple[Array, int]], target: Array, size: Array, allowed: Callable[[Array, Array], bool]
) -> int | None:
    """Add a node one stride (or less) towards a target; return its index, or None where the move isn't allowed."""
    away = np.array([np.max(np.abs(target - q) / size) for q, _ in tree])
    parent = int(np.argmin(away))
    start = tree[parent][0]
    share = min(1.0, _STRIDE / away[parent]) if away[parent] > 0 else 1.0
    node = target if share == 1.0 else start + share * (target - start)
    if not allowed(start, node):
        return None
    tree.append((node, parent))
    return len(tree) - 1


def _branch(tree: list[tuple[Array, int]], node: int) -> list[Array]:
    """Return the poses from a node to the tree's root."""
    out = []
    while node >= 0:
        q, node = tree[node]
        out.append(q)
    return out


def _shorten(way: list[Array], allowed: Callable[[Array, Array], bool], seed: int) -> list[Array]:
    """Return the way without the points that a straight move can pass by."""
    rng = np.random.default_rng(seed)
    for _ in range(_SHORTCUTS):
        if len(way) < 3:
            break
        first, last = sorted(rng.choice(len(way), size=2, replace=False))
        if last - first > 1 and allowed(way[first], way[last]):
            way = way[: first + 1] + way[last:]
    return way
