"""The limits as rows of a nonlinear program, on a grid over a period; each kind of limit has its builder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from robot_ident.limits.self_collision import LinkPairs, link_pairs
from robot_ident.limits.workspace_distance import FrameKinematics
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.robot.workspace import Clause
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.design.family import Setting


_SHARPNESS = 60.0  # of the smooth maximum over a rule's alternatives, per reach of the arm


@dataclass(frozen=True)
class Grid:
    """Where limits are asked for: q, dq, ddq [n, N] as expressions, `step` seconds apart, tightened by a share."""

    states: Sequence[Any]
    step: float
    tightening: float


@dataclass(frozen=True)
class Rows:
    """lower <= expression <= upper [m]; distance: in metres, kept by further clearance where a grid lets it slip.

    keeper: what has to live as long as the expression, for CasADi doesn't keep its callbacks.
    """

    expression: Any
    lower: Array
    upper: Array
    distance: bool = False
    keeper: Any = None


def shares(expressions: Sequence[Any], tightening: float) -> list[Rows]:
    """Return rows that stay between -1 and 1, less the tightening."""
    if not expressions:
        return []
    stacked = ca.vertcat(*expressions)
    upper = np.full(stacked.shape[0], 1.0 - tightening)
    return [Rows(stacked, -upper, upper)]


def joint_rows(setting: Setting, grid: Grid) -> list[Rows]:
    """Return position, velocity and acceleration as shares of their limits."""
    robot = setting.robot
    limits, rest = robot.limits, np.zeros(robot.n)
    middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
    sizes = ((middle, half), (rest, limits.velocity), (rest, limits.acceleration))
    found = [
        (state[joint, :].T - centre[joint]) / size[joint]
        for state, (centre, size) in zip(grid.states[:3], sizes, strict=True)
        for joint in range(robot.n)
    ]
    return shares(found, grid.tightening)


def torque_rows(setting: Setting, grid: Grid) -> list[Rows]:
    """Return the torque as a share of its limit, where it can come near."""
    if setting.torque is None:
        return []
    torque = setting.torque.map(grid.states[0].shape[1])(*grid.states[:3])
    limit = setting.robot.limits.torque
    return shares([torque[joint, :].T / limit[joint] for joint in setting.torque_joints], grid.tightening)


def workspace_rows(setting: Setting, grid: Grid) -> list[Rows]:
    """Return the distance from each rule's clause [m], with room for what happens between the points."""
    robot, q = setting.robot, grid.states[0]
    found: list[Any] = []
    for rule in robot.workspace:
        p = frame_function(robot, rule.frame).map(q.shape[1])(q)
        found += [_smooth_maximum(clause, p).T for clause in rule.clauses]
    if not found:
        return []
    stacked = ca.vertcat(*found)
    size = stacked.shape[0]
    return [Rows(stacked, np.full(size, _dip(robot, grid.step)), np.full(size, np.inf), distance=True)]


def _smooth_maximum(clause: Clause, p: Any) -> Any:
    """Return a smooth lower bound of a clause's largest distance: its alternatives' mean, weighted exp(k d)."""
    values = [alternative.value(p[0, :], p[1, :], p[2, :], ca.sqrt) for alternative in clause]
    if len(values) == 1:
        return values[0]
    largest = reduce(ca.fmax, values)
    weights = [ca.exp(_SHARPNESS * (value - largest)) for value in values]
    return sum(weight * value for weight, value in zip(weights, values, strict=True)) / sum(weights)


def _dip(robot: Robot, step: float) -> float:
    """Return how far [m] a frame may come nearer between two points of a grid with this step [s], about: a h^2 / 16."""
    span = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    reach = max(float(FrameKinematics(robot, rule.frame).reach(span)[0]) for rule in robot.workspace)
    turning = [not sliding for sliding in robot.prismatic]
    angular = float(np.median(robot.limits.acceleration[turning])) if any(turning) else 0.0
    linear = float(np.max(robot.limits.acceleration[list(robot.prismatic)])) if any(robot.prismatic) else 0.0
    return (reach * angular + linear) * step**2 / 16.0


_BLEND = 0.005  # m, width of the smooth minimum over the pairs
_FAR = 0.1  # m beyond the clearance at which a pair no longer counts
_USUAL = 0.7  # quantile of a pair's distance over random poses that is usual for it
_USUAL_POSES = 100
_STEEPEST = 20.0  # largest factor of a slack
_SAMPLES = 1000  # random poses that tell which pairs can come near


def collision_rows(setting: Setting, grid: Grid) -> list[Rows]:
    """Return the smallest distance between links less the clearance [m], one row for each point of the grid."""
    pairs, geometry = link_pairs(setting.robot)[0], setting.robot.geometry
    if pairs is None or geometry is None or not pairs.count:
        return []
    nearest = pairs.bound(geometry.random_poses(_SAMPLES)).min(axis=0)
    near = np.flatnonzero(nearest < geometry.clearance + _FAR)
    if not len(near):
        return []
    q = grid.states[0]
    points = int(q.shape[1])
    slack = _Slack(Nearest(pairs, near, geometry.clearance), points)
    lower = np.full(points, _dips(pairs, near, grid.step))
    return [Rows(slack(q).T, lower, np.full(points, np.inf), distance=True, keeper=slack)]


BUILDERS = (joint_rows, torque_rows, workspace_rows, collision_rows)
"""All kinds of limits that a search keeps."""


def _dips(pairs: LinkPairs, which: Any, step: float) -> float:
    """Return how far [m] links may come nearer between two points of a grid with this step [s], about: a h^2 / 16."""
    limits = pairs.robot.limits
    reach = pairs.reaches(np.maximum(np.abs(limits.lower), np.abs(limits.upper)))[which]
    return float(np.median(reach @ limits.acceleration)) * step**2 / 16.0


class Nearest:
    """A smooth lower bound of the smallest slack s_p among some pairs of links [m].

    -k log(sum_p exp(-s_p / k) + exp(-far / k)): less than the smallest by k log of the number that are as near. The
    slack is the distance less a clearance; where two links are near each other by construction it is multiplied, so
    that what is usual for them counts as far.
    """

    def __init__(self, pairs: LinkPairs, which: Any, clearance: float) -> None:
        """Take the pairs and which of them count."""
        self._pairs, self._which, self._clearance, self.joints = pairs, which, clearance, pairs.robot.n
        assert pairs.robot.geometry is not None
        drawn = np.array([pairs.distances(q, which) for q in pairs.robot.geometry.random_poses(_USUAL_POSES)])
        usual = np.maximum(np.quantile(drawn, _USUAL, axis=0) - clearance, _FAR / _STEEPEST)
        self._factor = np.ones(pairs.count)
        self._factor[which] = np.maximum(_FAR / usual, 1.0)
        self._last: tuple[bytes, Array, Array] | None = None

    def __call__(self, q: Array) -> tuple[Array, Array]:
        """Return the values [N] m and their gradients [N, n] at positions q [N, n]."""
        key = q.tobytes()
        if self._last is None or self._last[0] != key:
            bound = self._factor[self._which] * (self._pairs.bound(q)[:, self._which] - self._clearance)
            found = [self._at(pose, self._which[row < _FAR]) for pose, row in zip(q, bound, strict=True)]
            self._last = key, np.array([value for value, _ in found]), np.array([slope for _, slope in found])
        return self._last[1], self._last[2]

    def _at(self, q: Array, which: Any) -> tuple[float, Array]:
        if not len(which):
            return _FAR, np.zeros(len(q))
        slack = self._factor[which] * (self._pairs.distances(q, which) - self._clearance)
        least = min(float(slack.min()), _FAR)
        weights = np.exp(-(slack - least) / _BLEND)
        total = float(weights.sum() + np.exp(-(_FAR - least) / _BLEND))
        share = weights / total
        counts = share > 1e-6
        slope = (self._factor[which] * share)[counts] @ self._pairs.gradients(which[counts])
        return least - _BLEND * float(np.log(total)), slope


class _Slack(ca.Callback):  # type: ignore[misc]
    """CasADi's view of `Nearest`: q [n, N] -> [1, N]."""

    def __init__(self, nearest: Nearest, points: int) -> None:
        ca.Callback.__init__(self)
        self._nearest, self._points = nearest, points
        self._slope: Any = None
        self.construct("slack", {})

    def get_sparsity_in(self, index: int) -> Any:
        return ca.Sparsity.dense(self._nearest.joints, self._points)

    def get_sparsity_out(self, index: int) -> Any:
        return ca.Sparsity.dense(1, self._points)

    def eval(self, arguments: Any) -> list[Any]:
        """Return the values."""
        return [ca.DM(self._nearest(np.array(arguments[0]).T.copy())[0]).T]

    def has_jacobian(self) -> bool:
        return True

    def get_jacobian(self, name: str, inputs: Any, outputs: Any, options: Any) -> Any:
        """Return the function (q, values) -> the derivatives of every value by its own pose."""
        self._slope = _Slope(name, self._nearest, self._points)
        return self._slope


class _Slope(ca.Callback):  # type: ignore[misc]
    """The block-diagonal Jacobian of `_Slack`."""

    def __init__(self, name: str, nearest: Nearest, points: int) -> None:
        ca.Callback.__init__(self)
        self._nearest, self._joints, self._points = nearest, nearest.joints, points
        self.construct(name, {})

    def get_n_in(self) -> int:
        return 2

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, index: int) -> Any:
        return ca.Sparsity.dense(1 if index else self._joints, self._points)

    def get_sparsity_out(self, index: int) -> Any:
        rows = np.repeat(np.arange(self._points), self._joints).tolist()
        return ca.Sparsity.triplet(self._points, self._joints * self._points, rows, list(range(len(rows))))

    def eval(self, arguments: Any) -> list[Any]:
        """Return the derivatives, pose by pose."""
        slopes = self._nearest(np.array(arguments[0]).T.copy())[1]
        return [ca.DM(self.get_sparsity_out(0), slopes.ravel())]
