"""Maximum determinant over weights: the finite-dimensional problem between two searches for further states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from robot_ident.signals.motion import Array

_CENTRING = 0.1  # by which the complementarity is asked to fall in a step
_ITERATIONS = 150


@dataclass(frozen=True)
class Weights:
    """Weights [K] of the atoms, their information M [p, p], and multipliers of equalities, inequalities and total.

    gap: log det of the optimum over these atoms less that of M is at most this.
    """

    xi: Array
    information: Array
    equal: Array
    unequal: Array
    total: float
    gap: float


def maximise_log_det(
    rows: Array, equalities: Array, inequalities: Array, prior: Array, gap: float = 1e-4, start: Array | None = None
) -> Weights:
    """Return the weights xi >= 0, sum xi = 1 that maximise log det(M0 + sum_k xi_k B_k' B_k).

    Subject to sum_k xi_k g_k = 0 and sum_k xi_k h_k <= 0. rows B [K, n, p], equalities g [K, m], inequalities h [K, J],
    prior M0 [p, p]. A primal-dual interior-point method (Boyd and Vandenberghe 2004, section 11.7) with weights and
    slacks as its positive variables; the Newton matrix is reduced to one of the size p (p + 1) / 2 + m + J + 1.
    """
    problem = _Problem(rows, equalities, inequalities, prior)
    x, y, z = problem.start(start)
    for _ in range(_ITERATIONS):
        surrogate = float(x @ z)
        residual = problem.residual(x, y, z, 0.0)
        if surrogate < gap and np.linalg.norm(residual[: -len(x)]) < 1e-3 * gap:
            break
        target = _CENTRING * surrogate / len(x)
        dx, dy, dz = problem.step(x, y, z, target)
        length = min(1.0, 0.99 * _room(x, dx), 0.99 * _room(z, dz))
        before = np.linalg.norm(problem.residual(x, y, z, target))
        while length > 1e-10:
            after = problem.residual(x + length * dx, y + length * dy, z + length * dz, target)
            if np.linalg.norm(after) <= (1.0 - 0.01 * length) * before:
                break
            length *= 0.5
        else:
            break  # rounding is reached
        x, y, z = x + length * dx, y + length * dy, z + length * dz
    return problem.solution(x, y, z)


def _room(x: Array, dx: Array) -> float:
    """Return the longest step that leaves x + step dx positive."""
    falling = dx < 0.0
    return float(np.min(-x[falling] / dx[falling])) if falling.any() else np.inf


class _Problem:
    def __init__(self, rows: Array, equalities: Array, inequalities: Array, prior: Array) -> None:
        self.rows, self.prior = rows, prior
        self.count, slacks = len(rows), inequalities.shape[1]
        self.m = equalities.shape[1]
        self.matrix = np.zeros((self.m + slacks + 1, self.count + slacks))  # E x = e
        self.matrix[: self.m, : self.count] = equalities.T
        self.matrix[self.m : -1, : self.count] = inequalities.T
        self.matrix[self.m : -1, self.count :] = np.eye(slacks)
        self.matrix[-1, : self.count] = 1.0
        self.right = np.zeros(len(self.matrix))
        self.right[-1] = 1.0

    def start(self, weights: Array | None) -> tuple[Array, Array, Array]:
        even = np.full(self.count, 1.0 / self.count)
        xi = even if weights is None else 0.8 * weights / weights.sum() + 0.2 * even
        slack = np.maximum(0.1, -self.matrix[self.m : -1, : self.count] @ xi)
        x = np.concatenate([xi, slack])
        y = np.zeros(len(self.matrix))
        y[-1] = p = float(self.prior.shape[0])
        return x, y, 0.1 * p / len(x) / x

    def information(self, x: Array) -> Array:
        weighted = self.rows * np.sqrt(x[: self.count])[:, None, None]
        stacked = weighted.reshape(-1, self.rows.shape[2])
        return np.asarray(self.prior + stacked.T @ stacked)

    def _whitened(self, x: Array) -> Array:
        """Return L^-1 B_k' [p, K n] with L L' = M."""
        factor = np.linalg.cholesky(self.information(x))
        stacked = self.rows.reshape(-1, self.rows.shape[2])
        return np.asarray(solve_triangular(factor, stacked.T, lower=True))

    def residual(self, x: Array, y: Array, z: Array, target: float) -> Array:
        """Return the residuals of stationarity, of the constraints and of complementarity."""
        slope = np.zeros(len(x))
        slope[: self.count] = -(self._whitened(x) ** 2).sum(axis=0).reshape(self.count, -1).sum(axis=1)
        return np.concatenate([slope + self.matrix.T @ y - z, self.matrix @ x - self.right, x * z - target])

    def step(self, x: Array, y: Array, z: Array, target: float) -> tuple[Array, Array, Array]:
        """Return the Newton step of the perturbed optimality conditions.

        (Q + Z/X) dx + E' dy = b with Q = R' R, the Hessian of -log det M; elimination of dx leaves a positive definite
        matrix in R dx and dy.
        """
        white = self._whitened(x)
        p = len(white)
        blocks = white.T.reshape(self.count, -1, p)
        upper = np.triu_indices(p)
        scale = np.where(upper[0] == upper[1], 1.0, np.sqrt(2.0))
        products = np.matmul(blocks.transpose(0, 2, 1), blocks)  # L^-1 A_k L^-T
        reduced = np.zeros((len(scale) + len(self.matrix), len(x)))
        reduced[: len(scale), : self.count] = (products[:, upper[0], upper[1]] * scale).T
        reduced[len(scale) :] = self.matrix
        slope = np.zeros(len(x))
        slope[: self.count] = -np.trace(products, axis1=1, axis2=2)
        b = -slope - self.matrix.T @ y + target / x
        inverse = x / z
        normal = (reduced * inverse) @ reduced.T
        diagonal = np.einsum("ii->i", normal)
        diagonal[: len(scale)] += 1.0
        diagonal[len(scale) :] *= 1.0 + 1e-13  # equalities that depend on one another
        diagonal[len(scale) :] += 1e-14 * float(diagonal.max())
        right = reduced @ (inverse * b)
        right[len(scale) :] += self.matrix @ x - self.right
        solved = cho_solve(cho_factor(normal), right)
        dx = inverse * (b - reduced.T @ solved)
        return dx, solved[len(scale) :], target / x - z - z / x * dx

    def solution(self, x: Array, y: Array, z: Array) -> Weights:
        return Weights(
            xi=x[: self.count],
            information=self.information(x),
            equal=y[: self.m],
            unequal=y[self.m : -1],
            total=float(y[-1]),
            gap=float(x @ z),
        )
