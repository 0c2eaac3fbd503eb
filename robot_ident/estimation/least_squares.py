"""Least squares on the stacked equations, plain and weighted, with covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array

_RANK = 1e-10  # singular values below this share of the largest (columns scaled to norm 1) count as zero


@dataclass(frozen=True)
class Factor:
    """A QR factorisation of W^1/2 F with its columns scaled to norm 1: what every solution of one F shares.

    condition_number: s_max / s_min of that matrix, the paper's c1.
    """

    q: Array
    r: Array
    scale: Array
    root_weight: Array
    condition_number: float

    def solve(self, torque: Array) -> Array:
        """Return theta [p] (or [p, runs]) for torque [R] (or [R, runs])."""
        from scipy.linalg import solve_triangular

        right = (torque.T * self.root_weight).T
        solution = solve_triangular(self.r, self.q.T @ right)
        theta: Array = (solution.T / self.scale).T
        return theta

    def beside(self, further: Array, names: Sequence[str], source: str) -> Factor:
        """Factorise [F, G] for further columns G [R, k], what is known of F as it is; names: of all p + k.

        [F, G] = [Q, Q2] [[R, Q' G], [0, R2]] with Q2 R2 = G - Q Q' G. InputError as `factor`.
        """
        scaled, scale = _scaled(further * self.root_weight[:, None], names[len(self.scale) :], source)
        shared = self.q.T @ scaled
        rest = scaled - self.q @ shared
        again = self.q.T @ rest  # once more: what rounding has left along Q
        q, r = np.linalg.qr(rest - self.q @ again)
        whole = np.block([[self.r, shared + again], [np.zeros((len(r), len(self.r))), r]])
        condition = _condition_number(whole, names, source)
        return Factor(np.hstack([self.q, q]), whole, np.concatenate([self.scale, scale]), self.root_weight, condition)

    def inverse_information(self) -> Array:
        """Return (F' W F)^-1 [p, p]."""
        from scipy.linalg import solve_triangular

        half = solve_triangular(self.r, np.eye(len(self.r))) / self.scale[:, None]
        covariance: Array = half @ half.T
        return covariance


def factor(phi: Array, weight: Array, names: Sequence[str], source: str) -> Factor:
    """Factorise W^1/2 F for F [R, p] and weights [R]; InputError names the columns where F lacks rank."""
    root = np.sqrt(weight)
    scaled, scale = _scaled(phi * root[:, None], names, source)
    q, r = np.linalg.qr(scaled)
    return Factor(q, r, scale, root, _condition_number(r, names, source))


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


def ordinary(phi: Array, torque: Array, variance: Array, names: Sequence[str], source: str) -> tuple[Array, Array]:
    """Return (theta, covariance) of ordinary least squares: theta = F+ b (eq. 10), cov = F+ S F+'."""
    found = factor(phi, np.ones(len(torque)), names, source)
    theta = found.solve(torque)
    bread = found.inverse_information()
    covariance = bread @ (phi.T @ (phi * variance[:, None])) @ bread
    return theta, covariance
