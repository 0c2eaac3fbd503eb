"""What the optimiser minimises: smooth, differentiable forms of the criteria, as CasADi expressions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.signals.motion import Array


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
    return ca.Function("inverse_factor", [m], [_inverse_of_factor(_cholesky(m, p), p)])


def _cholesky(m: Any, p: int) -> list[list[Any]]:
    """Return the rows of the lower factor L of M = L L'."""
    factor: list[list[Any]] = [[None] * p for _ in range(p)]
    for j in range(p):
        pivot = m[j, j] - sum((factor[j][k] ** 2 for k in range(j)), ca.SX(0))
        factor[j][j] = ca.sqrt(pivot)
        for i in range(j + 1, p):
            factor[i][j] = (m[i, j] - sum((factor[i][k] * factor[j][k] for k in range(j)), ca.SX(0))) / factor[j][j]
    return factor


def _inverse_of_factor(factor: list[list[Any]], p: int) -> Any:
    """Return L^-1 by forward substitution."""
    rows: list[list[Any]] = [[ca.SX(0)] * p for _ in range(p)]
    for j in range(p):
        for i in range(j, p):
            right = ca.SX(1.0 if i == j else 0.0) - sum((factor[i][k] * rows[k][j] for k in range(j, i)), ca.SX(0))
            rows[i][j] = right / factor[i][i]
    return ca.vertcat(*(ca.horzcat(*row) for row in rows))


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
