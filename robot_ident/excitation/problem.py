"""The excitation problem: variables, criterion and limits as nonlinear programs on grids of a period."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.excitation.batch import Batch
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.excitation.limits import Certifier
from robot_ident.excitation.objective import (
    information_matrix,
    inverse_factor_function,
    log_det_function,
    smooth_log_condition,
)
from robot_ident.excitation.workspace_margin import FrameKinematics
from robot_ident.motion import Array
from robot_ident.robot.robot import Robot
from robot_ident.robot.symbolic import frame_function
from robot_ident.robot.workspace import Clause

SIGN_WIDTH = 0.035  # width of the smooth sign as a share of the speed that a joint can reach
_SHARPNESS = 60.0  # of the smooth maximum over a rule's alternatives, per reach of the arm
_SINGULAR = 1e-13  # share of the largest eigenvalue below which one is rounding
_EXACT_SAMPLES = 1500  # of a period in the exact criterion of an iterate


@dataclass(frozen=True)
class Setting:
    """What is designed: the robot, its regressor with smooth and exact sign (CasADi functions), sampling and criterion.

    variances [n] (Nm)^2 of the noise of one averaged period. floor: largest log10 det of the covariance (condition
    number only). poses [K, n]: where the rules are kept, for starts. torque: the torque that a state takes (CasADi
    function), where it can come near its limit.
    """

    robot: Robot
    smooth: Any
    exact: Any
    base_frequency: float
    harmonics: int
    sample_rate: float
    variances: Array
    criterion: str
    poses: Array
    torque: Any = None
    torque_joints: tuple[int, ...] = ()
    floor: float | None = None

    @property
    def samples(self) -> int:
        """Samples a period."""
        return round(self.sample_rate / self.base_frequency)

    @property
    def parameters(self) -> int:
        """Number of parameters p."""
        return int(self.exact.size2_out(0))


def reachable_speed(robot: Robot, base_frequency: float) -> Array:
    """Return the speed [n] rad/s that a joint can reach within its limits at the base frequency."""
    limits, w = robot.limits, 2.0 * np.pi * base_frequency
    return np.minimum(limits.velocity, np.minimum(limits.acceleration / w, 0.5 * (limits.upper - limits.lower) * w))


class Problem:
    """A setting with its scaling, its exact criterion and its nonlinear programs.

    The variables x are the coefficients [1 + 2 L, n] (rows q0, a_1.., b_1..), each divided by its scale.
    """

    def __init__(self, setting: Setting) -> None:
        """Prepare scales and the exact criterion; programs are built when they are first used."""
        self.setting = setting
        limits, order = setting.robot.limits, setting.harmonics
        speed = reachable_speed(setting.robot, setting.base_frequency)
        self.centre = np.zeros((1 + 2 * order, setting.robot.n))
        self.centre[0] = 0.5 * (limits.upper + limits.lower)
        self.scale = np.vstack([0.5 * (limits.upper - limits.lower), np.tile(speed, (2 * order, 1))])
        self.certifier = Certifier(setting.robot)
        self._points = min(setting.samples, _EXACT_SAMPLES)
        self._exact = Batch(setting.exact, self._points)

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients [1 + 2 L, n] of variables x."""
        return np.asarray(self.centre + self.scale * np.asarray(x).reshape(self.scale.shape, order="F"))

    def variables(self, coefficients: Array) -> Array:
        """Return the variables x of coefficients."""
        return np.asarray(((coefficients - self.centre) / self.scale).ravel(order="F"))

    def series(self, coefficients: Array) -> FourierSeries:
        """Return the Fourier series of coefficients."""
        order = self.setting.harmonics
        return FourierSeries(
            self.setting.base_frequency, coefficients[0], coefficients[1 : 1 + order].T, coefficients[1 + order :].T
        )

    def excitation(self, coefficients: Array) -> Excitation:
        """Return the excitation of coefficients."""
        robot = self.setting.robot
        return Excitation(robot.name, robot.joints, self.series(coefficients), self.setting.sample_rate)

    def evaluate(self, coefficients: Array) -> tuple[float, float]:
        """Return log10 det of the covariance and the condition number, with the exact sign function.

        From the eigenvalues of the normalised information matrix: for iterates; the verdict uses singular values.
        """
        setting, points = self.setting, self._points
        t: Array = np.arange(float(points)) / points / setting.base_frequency
        motion = self.series(coefficients).motion(t)
        columns = self._exact(motion) / np.sqrt(setting.variances * (points / setting.samples))[:, None]
        stacked = columns.reshape(-1, setting.parameters)
        gram = stacked.T @ stacked
        length = np.sqrt(np.diag(gram))
        if not np.all(length > 0):
            return float("inf"), float("inf")
        values = np.linalg.eigvalsh(gram / np.outer(length, length))
        if values[0] <= _SINGULAR * values[-1]:
            return float("inf"), float("inf")
        log10_det = -np.log10(values).sum() - 2.0 * np.log10(length).sum()
        return float(log10_det), float(np.sqrt(values[-1] / values[0]))

    def cost(self, log10_det: float, condition: float) -> float:
        """Return what is minimised, of exact values; inf where the determinant is above its floor."""
        if self.setting.criterion == "d-optimal":
            return log10_det
        floor = self.setting.floor
        return condition if floor is None or log10_det <= floor else float("inf")

    def workspace_lack(self, coefficients: Array) -> float:
        """Return by how much [m] the rules of the workspace are broken, 0 or less where they are kept."""
        margins = self.certifier.margins(self.excitation(coefficients))
        return -min((item.margin for item in margins.items if item.quantity == "workspace"), default=0.0)

    def cost_of_shrinking(self, factor: float) -> float:
        """Return about how much the cost grows when a motion's amplitude is multiplied by a factor."""
        return (
            -2.0 * self.setting.parameters * float(np.log10(factor)) if self.setting.criterion == "d-optimal" else 0.0
        )

    @cached_property
    def coarse(self) -> Program:
        """The program on a coarse grid, for the search."""
        order = self.setting.harmonics
        return Program(self, quadrature=max(60, 24 * order), grid=12 * order, tightening=4e-3, doublings=5)

    @cached_property
    def fine(self) -> Program:
        """The program on a fine grid, for the last step."""
        order = self.setting.harmonics
        return Program(self, quadrature=max(60, 30 * order), grid=36 * order, tightening=2e-4, doublings=7)


class Program:
    """A nonlinear program: a smooth criterion subject to the limits on a grid, tightened by a share of each."""

    def __init__(self, problem: Problem, *, quadrature: int, grid: int, tightening: float, doublings: int) -> None:
        """Build the expressions of criterion (see `smooth_log_condition` for doublings) and limits."""
        self.problem = problem
        setting = problem.setting
        self.x = ca.MX.sym("x", problem.scale.size)
        table = ca.reshape(self.x, *problem.scale.shape)
        self._coefficients = ca.DM(problem.centre) + ca.DM(problem.scale) * table
        period = 1.0 / setting.base_frequency
        offset = 0.37 / quadrature  # the quadrature's points fall between those of the limits
        states = self._motion((np.arange(quadrature) / quadrature + offset) * period)
        self.cost, floor = self._criterion(states, doublings)
        limits = self._motion(np.arange(grid) / grid * period)
        rows = [*self._joint_rows(limits), *self._torque_rows(limits)]
        workspace = self._workspace_rows(limits[0])
        self.rows, self.jacobian = ca.vertcat(*rows, *workspace), None
        if setting.floor is not None:
            self._add_floor(floor)
        size = len(rows) * grid
        self._clear = slice(size, size + len(workspace) * grid)
        self._clearance = _dip(problem, period / grid)
        self._lower = np.full(self.rows.shape[0], tightening - 1.0)
        self._upper = -self._lower
        self._lower[size:], self._upper[size:] = -np.inf, np.inf
        if setting.floor is not None:
            self._upper[-1] = setting.floor - 0.02
        self.value = ca.Function("cost", [self.x], [self.cost])

    def _add_floor(self, log10_det: Any) -> None:
        """Add the determinant as a row; its gradient comes from one backward sweep, not from a sweep by variable."""
        jacobian = ca.vertcat(ca.jacobian(self.rows, self.x), ca.gradient(log10_det, self.x).T)
        self.rows = ca.vertcat(self.rows, log10_det)
        unused = ca.MX.sym("p", 0)
        names = ["x", "p"], ["g", "jac_g_x"]
        self.jacobian = ca.Function("nlp_jac_g", [self.x, unused], [self.rows, jacobian], *names)

    def bounds(self, clearance: float = 0.0) -> tuple[Array, Array]:
        """Return the bounds of the rows; rules are kept by `clearance` [m] more than the grid asks for."""
        lower = self._lower.copy()
        lower[self._clear] = self._clearance + clearance
        return lower, self._upper

    def _motion(self, t: Array) -> tuple[Any, Any, Any]:
        """Return q, dq, ddq [n, N] at instants t, linear in the coefficients (Swevers et al. 1997, eq. 11)."""
        setting = self.problem.setting
        w = 2.0 * np.pi * setting.base_frequency * np.arange(1, setting.harmonics + 1)
        sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        zero, one = np.zeros((len(t), 1)), np.ones((len(t), 1))
        rows = ([one, sin / w, -cos / w], [zero, cos, sin], [zero, -sin * w, cos * w])
        q, dq, ddq = (ca.mtimes(ca.DM(np.hstack(row)), self._coefficients).T for row in rows)
        return q, dq, ddq

    def _criterion(self, states: tuple[Any, Any, Any], doublings: int) -> tuple[Any, Any]:
        """Return the smooth cost and log10 det of the covariance."""
        setting = self.problem.setting
        scale = _column_scale(self.problem)
        matrix = information_matrix(setting.smooth, states, 1.0 / setting.variances, scale, setting.samples)
        log_det = log_det_function(setting.parameters)(matrix)
        log10_det = (2.0 * np.log(scale).sum() - log_det) / np.log(10.0)
        if setting.criterion == "d-optimal":
            return log10_det, log10_det
        inverse_factor = inverse_factor_function(setting.parameters)
        return smooth_log_condition(matrix, inverse_factor, doublings), log10_det

    def _joint_rows(self, states: tuple[Any, Any, Any]) -> list[Any]:
        """Return position, velocity and acceleration as shares of their limits, -1 to 1."""
        robot = self.problem.setting.robot
        limits, rest = robot.limits, np.zeros(robot.n)
        middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
        sizes = ((middle, half), (rest, limits.velocity), (rest, limits.acceleration))
        return [
            (state[joint, :].T - centre[joint]) / size[joint]
            for state, (centre, size) in zip(states, sizes, strict=True)
            for joint in range(robot.n)
        ]

    def _torque_rows(self, states: tuple[Any, Any, Any]) -> list[Any]:
        """Return the torque as a share of its limit, -1 to 1."""
        if self.problem.setting.torque is None:
            return []
        robot = self.problem.setting.robot
        torque = self.problem.setting.torque.map(states[0].shape[1])(*states)
        limited = self.problem.setting.torque_joints
        return [torque[joint, :].T / robot.limits.torque[joint] for joint in limited]

    def _workspace_rows(self, q: Any) -> list[Any]:
        """Return the distance from each rule's clause [m]."""
        robot = self.problem.setting.robot
        rows: list[Any] = []
        for rule in robot.workspace:
            p = frame_function(robot, rule.frame).map(q.shape[1])(q)
            rows += [_smooth_maximum(clause, p).T for clause in rule.clauses]
        return rows


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


def _dip(problem: Problem, step: float) -> float:
    """Return how far [m] a frame may come nearer between two points of a grid with this step [s], about: a h^2 / 16."""
    robot = problem.setting.robot
    if not robot.workspace:
        return 0.0
    span = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    reach = max(float(FrameKinematics(robot, rule.frame).reach(span)[0]) for rule in robot.workspace)
    turning = [not sliding for sliding in robot.prismatic]
    angular = float(np.median(robot.limits.acceleration[turning])) if any(turning) else 0.0
    linear = float(np.max(robot.limits.acceleration[list(robot.prismatic)])) if any(robot.prismatic) else 0.0
    return (reach * angular + linear) * step**2 / 16.0


def _column_scale(problem: Problem) -> Array:
    """Return one over the typical size of each column [p], from random coefficients of the size of the variables'
    scales.
    """
    setting = problem.setting
    rng = np.random.default_rng(0)
    sizes = []
    for _ in range(5):
        table = problem.centre + problem.scale * rng.uniform(-0.3, 0.3, problem.scale.shape)
        motion = problem.series(table).motion(np.linspace(0.0, 1.0 / setting.base_frequency, 50))
        flat = np.array(setting.smooth.map(50)(motion.q.T, motion.dq.T, motion.ddq.T))
        columns = flat.reshape(setting.robot.n, 50, setting.parameters) / np.sqrt(setting.variances)[:, None, None]
        sizes.append(np.sqrt((columns**2).sum(axis=0).mean(axis=0) * setting.samples))
    size = np.mean(sizes, axis=0)
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))
