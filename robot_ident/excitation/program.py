"""A nonlinear program: a smooth criterion subject to the limits on a grid."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from robot_ident.excitation.collision_rows import collision_rows
from robot_ident.excitation.cramer_rao import line_bases, line_deviations, line_rows
from robot_ident.excitation.objective import (
    inverse_factor_function,
    log_det_function,
    smooth_log_condition,
    weighted_rows,
)
from robot_ident.excitation.rows import BUILDERS, Grid
from robot_ident.excitation.setting import Setting
from robot_ident.signals.motion import Array

_BELOW_FLOOR = 0.02  # decades by which a determinant is asked to stay below its floor


class Grids(NamedTuple):
    """Points of the criterion and of the limits over a period, and the share by which these are tightened."""

    quadrature: int
    limits: int
    tightening: float


class Scaling(Protocol):
    """How variables make coefficients [1 + 2 L, n]: `centre` plus `scale` times them, in the rows `free`."""

    free: np.ndarray
    centre: Array
    scale: Array


class Program:
    """A nonlinear program in the scaled variables x; limits come from the builders in `rows`."""

    def __init__(self, setting: Setting, scaling: Scaling, grids: Grids, *, doublings: int) -> None:
        """Build the expressions of criterion (see `smooth_log_condition` for doublings) and limits."""
        self.setting = setting
        self.x = ca.MX.sym("x", len(scaling.free) * setting.robot.n)
        table = ca.reshape(self.x, len(scaling.free), setting.robot.n)
        self._free = scaling.free
        self._coefficients = ca.DM(scaling.centre[scaling.free]) + ca.DM(scaling.scale[scaling.free]) * table
        period = setting.family.period
        offset = 0.37 / grids.quadrature  # the quadrature's points fall between those of the limits
        times = (np.arange(grids.quadrature) / grids.quadrature + offset) * period
        self.cost, log10_det = self._criterion(times, column_scale(setting, scaling), doublings)
        instants = np.arange(grids.limits) / grids.limits * period
        grid = Grid(self._states(instants, 2), period / grids.limits, grids.tightening)
        rows = [part for build in (*BUILDERS, collision_rows) for part in build(setting, grid)]
        self._keepers = [part.keeper for part in rows]
        self.rows, self.jacobian = ca.vertcat(*(part.expression for part in rows)), None
        self._lower, self._upper = (
            np.concatenate([getattr(part, side) for part in rows]) for side in ("lower", "upper")
        )
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
        """Return q, dq, ddq and further derivatives [n, N] up to the highest, at instants t, linear in the coefficients
        (Swevers et al. 1997, eq. 11).
        """
        bases = self.setting.family.bases(t, highest)
        return [ca.mtimes(ca.DM(basis[:, self._free]), self._coefficients).T for basis in bases]

    def _criterion(self, t: Array, scale: Array, doublings: int) -> tuple[Any, Any]:
        """Return the smooth cost and log10 det of the covariance."""
        setting = self.setting
        states = self._states(t, setting.smooth.n_in() - 1)
        size = np.sqrt(setting.family.samples / len(t) / setting.variances)
        rows, given = weighted_rows(setting.smooth, states, size, scale), 0
        if setting.criterion == "crlb":
            moved = self._moved_rows(states, t, size)
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

    def _moved_rows(self, states: Sequence[Any], t: Array, size: Array) -> Any:
        setting, family = self.setting, self.setting.family
        assert setting.position_variances is not None
        deviations = line_deviations(family.orders, setting.position_variances, family.samples)
        return line_rows(setting.slopes, states, line_bases(family.orders, family.base_frequency, t), size, deviations)


def column_scale(setting: Setting, scaling: Scaling) -> Array:
    """Return one over the typical size of each column [p], from random coefficients of the size of the variables'
    scales.
    """
    rng, family = np.random.default_rng(0), setting.family
    sizes = []
    for _ in range(5):
        table = scaling.centre.copy()
        draw = rng.uniform(-0.3, 0.3, scaling.scale.shape)
        table[scaling.free] += scaling.scale[scaling.free] * draw[scaling.free]
        bases = family.bases(np.linspace(0.0, family.period, 50), setting.smooth.n_in() - 1)
        flat = np.array(setting.smooth.map(50)(*((basis @ table).T for basis in bases)))
        columns = flat.reshape(setting.robot.n, 50, setting.parameters) / np.sqrt(setting.variances)[:, None, None]
        sizes.append(np.sqrt((columns**2).sum(axis=0).mean(axis=0) * family.samples))
    size = np.mean(sizes, axis=0)
    return np.asarray(1.0 / np.where(size > 0, size, 1.0))
