"""The excitation problem: variables, exact criterion, and smooth programs within limits on grids of a period."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from robot_ident.design.constraints import BUILDERS, Grid
from robot_ident.design.criteria import bound_information, line_bases, line_rows
from robot_ident.design.family import Setting
from robot_ident.limits.certifier import Certifier
from robot_ident.limits.interval import Batch
from robot_ident.signals.motion import Array
from robot_ident.trajectories.excitation import Excitation


def smooth_sign(widths: Array) -> Callable[[Any], Any]:
    """Return sign(v) as tanh(v / width), the width taken from the joints' velocities in v."""
    n = len(widths)
    names = {("dq" if n == 1 else f"dq_{joint}"): float(widths[joint]) for joint in range(n)}

    def sign(v: Any) -> Any:
        found = [names[symbol.name()] for symbol in ca.symvar(v) if symbol.name() in names]
        return ca.tanh(v / max(found, default=float(np.max(widths))))

    return sign


def weighted_rows(phi: Any, states: Sequence[Any], size: Array, scale: Array) -> Any:
    """Return S^-1/2 F D [n N, p] along the N states of a grid.

    phi: CasADi function of a state -> [n, p]. states: q, dq, ddq (and further derivatives where phi takes them) [n, N]
    expressions; size [n]: weight of each joint's torque; scale D [p] keeps the numbers near one.
    """
    n, points = states[0].shape
    symbols = [ca.SX.sym("x", n) for _ in range(phi.n_in())]
    rows = ca.mtimes([ca.diag(ca.DM(size)), phi(*symbols), ca.diag(ca.DM(scale))])
    columns = ca.Function("rows", symbols, [ca.densify(rows)]).map(points)(*states[: phi.n_in()])
    return ca.vertcat(*ca.horzsplit(columns, phi.size2_out(0)))


def log_det_function(p: int, given: int = 0) -> Any:
    """Return the CasADi function M -> log det M of positive definite matrices [p, p], by Cholesky.

    given: so many leading unknowns are eliminated first; the determinant is that of the Schur complement they leave.
    The square root of a pivot that is not positive gives nan, which makes the optimiser shorten its step.
    """
    m = ca.SX.sym("m", p, p)
    factor = _cholesky(m, p)
    return ca.Function("log_det", [m], [2 * sum(ca.log(factor[j][j]) for j in range(given, p))])


def inverse_factor_function(p: int) -> Any:
    """Return the CasADi function M -> L^-1 with M = L L', for positive definite matrices [p, p]."""
    m = ca.SX.sym("m", p, p)
    factor, rows = _cholesky(m, p), [[ca.SX(0)] * p for _ in range(p)]
    for j in range(p):  # forward substitution
        for i in range(j, p):
            right = ca.SX(1.0 if i == j else 0.0) - sum((factor[i][k] * rows[k][j] for k in range(j, i)), ca.SX(0))
            rows[i][j] = right / factor[i][i]
    return ca.Function("inverse_factor", [m], [ca.vertcat(*(ca.horzcat(*row) for row in rows))])


def _cholesky(m: Any, p: int) -> list[list[Any]]:
    """Return the rows of the lower factor L of M = L L'."""
    factor: list[list[Any]] = [[None] * p for _ in range(p)]
    for j in range(p):
        pivot = m[j, j] - sum((factor[j][k] ** 2 for k in range(j)), ca.SX(0))
        factor[j][j] = ca.sqrt(pivot)
        for i in range(j + 1, p):
            factor[i][j] = (m[i, j] - sum((factor[i][k] * factor[j][k] for k in range(j)), ca.SX(0))) / factor[j][j]
    return factor


def smooth_log_condition(information: Any, inverse_factor: Any, doublings: int) -> Any:
    """Return a smooth upper bound of log(s_max / s_min) of the column-normalised regressor.

    With R the information matrix scaled to a unit diagonal, s^2 are its eigenvalues, and with m = 2^doublings
    (tr R^m)^(1/m) >= l_max, (tr R^-m)^(1/m) >= 1 / l_min, each by at most the factor p^(1/m).
    """
    inverse_length = 1 / ca.sqrt(ca.diag(information))
    correlation = information * ca.mtimes(inverse_length, inverse_length.T)
    factor = inverse_factor(correlation)
    power = 2**doublings
    total = 0
    for matrix in (correlation, ca.mtimes(factor.T, factor)):
        exponent = 0.0
        for _ in range(doublings - 1):  # tr R^(2 k) = |R^k|^2, so one squaring fewer is needed
            size = ca.sqrt(ca.sumsqr(matrix))
            matrix = matrix / size
            exponent = 2 * (exponent + ca.log(size))
            matrix = ca.mtimes(matrix, matrix)
        total += (2 * exponent + ca.log(ca.sumsqr(matrix))) / power
    return 0.5 * total


_BELOW_FLOOR = 0.02  # decades by which a determinant is asked to stay below its floor


class Program:
    """A nonlinear program in the scaled variables x; limits come from the builders in `rows`."""

    def __init__(self, problem: Problem, *, quadrature: int, limits: int, tightening: float, doublings: int) -> None:
        """Build the expressions of the criterion, at `quadrature` points of a period (see `smooth_log_condition` for
        doublings), and of the limits, tightened by a share, at `limits` points.
        """
        self.setting, self._free = setting, free = problem.setting, problem.free
        self.x = ca.MX.sym("x", problem.size)
        table = ca.reshape(self.x, len(free), setting.robot.n)
        self._coefficients = ca.DM(problem.centre[free]) + ca.DM(problem.scale[free]) * table
        period = setting.family.period
        offset = 0.37 / quadrature  # the quadrature's points fall between those of the limits
        times = (np.arange(quadrature) / quadrature + offset) * period
        self.cost, log10_det = self._criterion(times, column_scale(problem), doublings)
        grid = Grid(self._states(np.arange(limits) / limits * period, 2), period / limits, tightening)
        rows = [part for build in BUILDERS for part in build(setting, grid)]
        self._keepers = [part.keeper for part in rows]
        self.rows, self.jacobian = ca.vertcat(*(part.expression for part in rows)), None
        self._lower = np.concatenate([part.lower for part in rows])
        self._upper = np.concatenate([part.upper for part in rows])
        self._distance = np.concatenate([np.full(len(part.lower), part.distance) for part in rows])
        if setting.criterion == "condition" and setting.floor is not None:
            self._add_floor(log10_det, setting.floor - _BELOW_FLOOR)
        self.value = ca.Function("cost", [self.x], [self.cost])

    def _add_floor(self, log10_det: Any, floor: float) -> None:
        """Add the determinant as a row; its gradient comes from one backward sweep, not from a sweep by variable."""
        jacobian = ca.vertcat(ca.jacobian(self.rows, self.x), ca.gradient(log10_det, self.x).T)
        self.rows = ca.vertcat(self.rows, log10_det)
        self._lower, self._upper = np.append(self._lower, -np.inf), np.append(self._upper, floor)
        self._distance = np.append(self._distance, False)
        unused = ca.MX.sym("p", 0)
        names = ["x", "p"], ["g", "jac_g_x"]
        self.jacobian = ca.Function("nlp_jac_g", [self.x, unused], [self.rows, jacobian], *names)

    def bounds(self, clearance: float = 0.0) -> tuple[Array, Array]:
        """Return the bounds of the rows; distances are kept by `clearance` [m] more than the grid asks for."""
        return self._lower + clearance * self._distance, self._upper

    def _states(self, t: Array, highest: int) -> list[Any]:
        """Return q, dq, ddq and further derivatives [n, N] at instants t, linear in the coefficients (eq. 11)."""
        bases = self.setting.family.bases(t, highest)
        return [ca.mtimes(ca.DM(basis[:, self._free]), self._coefficients).T for basis in bases]

    def _criterion(self, t: Array, scale: Array, doublings: int) -> tuple[Any, Any]:
        """Return the smooth cost and log10 det of the covariance."""
        setting = self.setting
        states = self._states(t, setting.smooth.n_in() - 1)
        size = np.sqrt(setting.family.samples / len(t) / setting.variances)
        rows, given = weighted_rows(setting.smooth, states, size, scale), 0
        if setting.criterion == "crlb":
            family = setting.family
            bases = line_bases(family.orders, family.base_frequency, t)
            moved = line_rows(setting.slopes, states, bases, size, setting.line_deviations)
            rows, given = ca.horzcat(moved, rows), moved.shape[1]
        total = given + setting.parameters
        known = np.zeros((total, total))
        known[:given, :given] = np.eye(given)  # what the positions tell of the lines, in their deviations
        if setting.prior is not None:
            known[given:, given:] = setting.prior * np.outer(scale, scale)
        matrix = ca.mtimes(rows.T, rows)
        matrix = matrix + ca.DM(known) if known.any() else matrix
        log10_det = (2.0 * np.log(scale).sum() - log_det_function(total, given)(matrix)) / np.log(10.0)
        if setting.criterion != "condition":
            return log10_det, log10_det
        return smooth_log_condition(matrix, inverse_factor_function(total), doublings), log10_det


def column_scale(problem: Problem) -> Array:
    """Return one over the typical size of each column [p], from random coefficients as large as the variables."""
    rng, setting, family, free = np.random.default_rng(0), problem.setting, problem.setting.family, problem.free
    sizes = []
    for _ in range(5):
        table, draw = problem.centre.copy(), rng.uniform(-0.3, 0.3, problem.scale.shape)
        table[free] += problem.scale[free] * draw[free]
        bases = family.bases(np.linspace(0.0, family.period, 50), setting.smooth.n_in() - 1)
        flat = np.array(setting.smooth.map(50)(*((basis @ table).T for basis in bases)))
        columns = flat.reshape(setting.robot.n, 50, setting.parameters) / np.sqrt(setting.variances)[:, None, None]
        sizes.append(np.sqrt((columns**2).sum(axis=0).mean(axis=0) * family.samples))
    size = np.mean(sizes, axis=0)
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))


_SINGULAR = 1e-13  # share of the largest eigenvalue below which one is rounding
_EXACT_SAMPLES = 1500  # of a period in the exact criterion of an iterate
_JOINT_LIMITS = ("position", "velocity", "acceleration", "torque")
_CROWDED = 10  # orders above which a grid grows by fewer points an order


class Values(NamedTuple):
    """Exact values of a motion: log10 det of the covariance and condition number."""

    log10_det: float
    condition: float


class Problem:
    """A setting with its scaling, its exact criterion and its nonlinear programs.

    The variables x are the free rows of the coefficients [1 + 2 L, n] (rows q0, a_1.., b_1..), each over its scale.
    """

    def __init__(self, setting: Setting) -> None:
        """Prepare scales and the exact criterion; programs are built when they are first used."""
        self.setting = setting
        limits, order = setting.robot.limits, setting.family.harmonics
        speed = setting.family.reachable_speed(setting.robot)
        self.free = setting.family.free
        self.centre = np.zeros((1 + 2 * order, setting.robot.n))
        self.centre[0] = 0.5 * (limits.upper + limits.lower)
        self.scale = np.vstack([0.5 * (limits.upper - limits.lower), np.tile(speed, (2 * order, 1))])
        self.certifier = Certifier(setting.robot)
        self._points = min(setting.family.samples, _EXACT_SAMPLES)
        self._weight = 1.0 / np.sqrt(setting.variances * (self._points / setting.family.samples))

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.free) * self.setting.robot.n

    def coefficients(self, x: Array) -> Array:
        """Return the coefficients [1 + 2 L, n] of variables x."""
        out = self.centre.copy()
        out[self.free] += self.scale[self.free] * np.asarray(x).reshape((len(self.free), -1), order="F")
        return out

    def variables(self, coefficients: Array) -> Array:
        """Return the variables x of coefficients."""
        return np.asarray(((coefficients - self.centre) / self.scale)[self.free].ravel(order="F"))

    def excitation(self, coefficients: Array) -> Excitation:
        """Return the excitation of coefficients."""
        return self.setting.family.excitation(self.setting.robot, coefficients)

    def information(self, coefficients: Array) -> Array:
        """Return what one averaged period tells [p, p], with the exact sign function and without the prior."""
        setting = self.setting
        motion = setting.family.motion(coefficients, self._points)
        exact = self._exact
        columns = setting.structure.columns(motion, setting.values) if exact is None else exact(motion)
        phi = columns * self._weight[:, None]
        if setting.criterion != "crlb":
            stacked = phi.reshape(-1, setting.parameters)
            return np.asarray(stacked.T @ stacked)
        slopes = self._slopes(motion) * self._weight[:, None]
        times = np.arange(float(self._points)) / self._points * setting.family.period
        bases = line_bases(setting.family.orders, setting.family.base_frequency, times)
        return bound_information(phi, slopes, bases, setting.line_deviations)

    def evaluate(self, coefficients: Array) -> Values:
        """Return log10 det of the covariance and the condition number, with the exact sign function.

        From the eigenvalues of the normalised information matrix: for iterates; the verdict uses singular values.
        """
        gram = self.information(coefficients)
        if self.setting.prior is not None:
            gram = gram + self.setting.prior
        length = np.sqrt(np.diag(gram))
        if not np.all(length > 0):
            return Values(float("inf"), float("inf"))
        values = np.linalg.eigvalsh(gram / np.outer(length, length))
        if values[0] <= _SINGULAR * values[-1]:
            return Values(float("inf"), float("inf"))
        log10_det = -np.log10(values).sum() - 2.0 * np.log10(length).sum()
        return Values(float(log10_det), float(np.sqrt(values[-1] / values[0])))

    def cost(self, values: Values) -> float:
        """Return what is minimised, of exact values; inf where the determinant is above its floor."""
        if self.setting.criterion != "condition":
            return values.log10_det
        floor = self.setting.floor
        return values.condition if floor is None or values.log10_det <= floor else float("inf")

    def lack(self, coefficients: Array) -> float:
        """Return by how much [m] rules of distance are broken, 0 or less where they are kept."""
        margins = self.certifier.margins(self.excitation(coefficients))
        return -min((item.margin for item in margins.items if item.quantity not in _JOINT_LIMITS), default=0.0)

    def cost_of_shrinking(self, factor: float) -> float:
        """Return about how much the cost grows when a motion's amplitude is multiplied by a factor."""
        if self.setting.criterion == "condition":
            return 0.0
        return -2.0 * self.setting.parameters * float(np.log10(factor))

    @cached_property
    def coarse(self) -> Program:
        """The program on a coarse grid, for the search."""
        quadrature = self._grid(24, 600 if self.setting.brief else 60)
        return Program(self, quadrature=quadrature, limits=self._grid(12, 12), tightening=4e-3, doublings=5)

    @cached_property
    def fine(self) -> Program:
        """The program on a fine grid, for the last step."""
        quadrature = self._grid(30, 1000 if self.setting.brief else 60)
        return Program(self, quadrature=quadrature, limits=self._grid(36, 36), tightening=2e-4, doublings=7)

    def _grid(self, per_order: int, least: int) -> int:
        """Return the points of a grid: many an order of a usual motion, fewer where a motion has very many."""
        order = self.setting.family.harmonics
        return max(least, per_order * min(order, _CROWDED) + per_order // 3 * max(0, order - _CROWDED))

    @cached_property
    def _exact(self) -> Batch | None:
        return None if self.setting.exact is None else Batch(self.setting.exact, self._points)

    @cached_property
    def _slopes(self) -> Batch:
        return Batch(self.setting.exact_slopes, self._points)
