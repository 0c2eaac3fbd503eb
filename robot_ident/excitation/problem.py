"""The excitation problem: its variables, its exact criterion, and its nonlinear programs on grids of a period."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_ident.excitation.batch import Batch
from robot_ident.excitation.cramer_rao import bound_information, line_bases, line_deviations
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import FourierSeries
from robot_ident.excitation.limits import Certifier
from robot_ident.excitation.program import Grids, Program
from robot_ident.excitation.setting import Setting
from robot_ident.signals.motion import Array, Motion

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

    def series(self, coefficients: Array) -> FourierSeries:
        """Return the Fourier series of coefficients."""
        return self.setting.family.series(coefficients)

    def excitation(self, coefficients: Array) -> Excitation:
        """Return the excitation of coefficients."""
        robot = self.setting.robot
        return Excitation(robot.name, robot.joints, self.series(coefficients), self.setting.family.sample_rate)

    def information(self, coefficients: Array) -> Array:
        """Return what one averaged period tells [p, p], with the exact sign function and without the prior."""
        setting = self.setting
        motion = setting.family.motion(coefficients, self._points)
        phi = self._columns(motion) * self._weight[:, None]
        if setting.criterion != "crlb":
            stacked = phi.reshape(-1, setting.parameters)
            return np.asarray(stacked.T @ stacked)
        slopes = self._slopes(motion) * self._weight[:, None]
        bases = line_bases(setting.family.orders, setting.family.base_frequency, self._times)
        return bound_information(phi, slopes, bases, self._deviations)

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
        return Program(self.setting, self, Grids(quadrature, self._grid(12, 12), 4e-3), doublings=5)

    @cached_property
    def fine(self) -> Program:
        """The program on a fine grid, for the last step."""
        quadrature = self._grid(30, 1000 if self.setting.brief else 60)
        return Program(self.setting, self, Grids(quadrature, self._grid(36, 36), 2e-4), doublings=7)

    def _grid(self, per_order: int, least: int) -> int:
        """Return the points of a grid: many an order of a usual motion, fewer where a motion has very many."""
        order = self.setting.family.harmonics
        return max(least, per_order * min(order, _CROWDED) + per_order // 3 * max(0, order - _CROWDED))

    def _columns(self, motion: Motion) -> Array:
        if self._exact is None:
            return self.setting.structure.columns(motion, self.setting.values)
        return self._exact(motion)

    @cached_property
    def _exact(self) -> Batch | None:
        return None if self.setting.exact is None else Batch(self.setting.exact, self._points)

    @cached_property
    def _slopes(self) -> Batch:
        return Batch(self.setting.exact_slopes, self._points)

    @cached_property
    def _times(self) -> Array:
        return np.arange(float(self._points)) / self._points * self.setting.family.period

    @cached_property
    def _deviations(self) -> Array:
        setting = self.setting
        assert setting.position_variances is not None
        return line_deviations(setting.family.orders, setting.position_variances, setting.family.samples)
