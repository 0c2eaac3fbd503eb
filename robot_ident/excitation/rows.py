"""The limits as rows of a nonlinear program, on a grid over a period; each kind of limit has its builder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from robot_ident.excitation.workspace_margin import FrameKinematics
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.robot.workspace import Clause
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.excitation.setting import Setting

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


BUILDERS = (joint_rows, torque_rows, workspace_rows)
"""All kinds of limits that a search keeps."""


def _smooth_maximum(clause: Clause, p: Any) -> Any:
    """Return a smooth lower bound of the largest distance among a clause's alternatives: their mean weighted by exp(k
    d).
    """
    values = [alternative.value(p[0, :], p[1, :], p[2, :], ca.sqrt) for alternative in clause]
    if len(values) == 1:
        return values[0]
    largest = values[0]
    for value in values[1:]:
        largest = ca.fmax(largest, value)
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
