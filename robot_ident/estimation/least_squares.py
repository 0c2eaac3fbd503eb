"""Weighted least squares on the stacked equations by QR factorisation, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array

_RANK = 1e-10  # singular values below this share of the largest (columns scaled to norm 1) count as zero


@dataclass(frozen=True)
class Factor:
    """A QR factorisation of weighted rows W^1/2 F, columns scaled to norm 1: what every solution of one F shares.

    condition_number: s_max / s_min of that matrix, the paper's c1.
    """

    q: Array
    r: Array
    scale: Array
    condition_number: float

    def solve(self, torque: Array) -> Array:
        """Return theta [p] (or [p, runs]) for the torque [R] (or [R, runs]), weighted as the rows are."""
        from scipy.linalg import solve_triangular

        return np.asarray((solve_triangular(self.r, self.q.T @ torque).T / self.scale).T)

    def beside(self, further: Array, names: Sequence[str], source: str) -> Factor:
        """Factorise [F, G] for further columns G [R, k], what is known of F as it is; names: of all p + k.

        [F, G] = [Q, Q2] [[R, Q' G], [0, R2]] with Q2 R2 = G - Q Q' G. InputError as `factor`.
        """
        scaled, scale = _scaled(further, names[len(self.scale) :], source)
        shared = self.q.T @ scaled
        rest = scaled - self.q @ shared
        again = self.q.T @ rest  # once more: what rounding has left along Q
        q, r = np.linalg.qr(rest - self.q @ again)
        whole = np.block([[self.r, shared + again], [np.zeros((len(r), len(self.r))), r]])
        condition = _condition_number(whole, names, source)
        return Factor(np.hstack([self.q, q]), whole, np.concatenate([self.scale, scale]), condition)

    def inverse_information(self) -> Array:
        """Return (F' W F)^-1 [p, p]."""
        from scipy.linalg import solve_triangular

        half = solve_triangular(self.r, np.eye(len(self.r))) / self.scale[:, None]
        return np.asarray(half @ half.T)


def factor(rows: Array, names: Sequence[str], source: str) -> Factor:
    """Factorise weighted rows W^1/2 F [R, p]; InputError names the columns where F lacks rank."""
    scaled, scale = _scaled(rows, names, source)
    q, r = np.linalg.qr(scaled)
    return Factor(q, r, scale, _condition_number(r, names, source))


def _scaled(phi: Array, names: Sequence[str], source: str) -> tuple[Array, Array]:
    """Return columns of norm 1 and the norms that they had; InputError names those without one."""
    scale = np.linalg.norm(phi, axis=0)
    silent = [name for name, size in zip(names, scale, strict=True) if size == 0.0]
    if silent:
        raise InputError(
            f"{source}: the motion does not excite {', '.join(silent)}; move the joints that it depends on"
        )
    return phi / scale, scale


def _condition_number(r: Array, names: Sequence[str], source: str) -> float:
    """Return s_max / s_min of a triangular factor [p, p]; InputError names the columns that depend on each other."""
    _, singular, vectors = np.linalg.svd(r)
    if singular[-1] < _RANK * singular[0]:
        blame = [names[k] for k in np.argsort(-np.abs(vectors[-1])) if abs(vectors[-1][k]) > 0.1]
        raise InputError(
            f"{source}: the data can't tell {', '.join(blame)} apart: their columns depend on each other;"
            " excite more joints or drop an effect"
        )
    return float(singular[0] / singular[-1])


def held_softly(rows: Array, right: Array, towards: Array, spread: float) -> Array:
    """Return x [p] that minimises |rows x - right|^2 + |x_k - towards|^2 / spread^2, x_k its last k elements."""
    p, k = rows.shape[1], len(towards)
    size = np.linalg.norm(rows, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    stacked = np.vstack([rows, np.eye(k, p, p - k) / spread]) / size
    found, *_ = np.linalg.lstsq(stacked, np.concatenate([right, towards / spread]), rcond=None)
    return np.asarray(found / size)
