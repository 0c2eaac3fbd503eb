"""Least squares judged on pieces of the path that it hasn't seen, by normal equations of each joint and piece.

The torque of joint j is a_j Y_j theta + own columns: Y the base columns, a_j the scale in which its effort is
reported, own what belongs to its row alone. Any choice of columns is fitted and judged without touching a row again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.effects.torque_scale import SPREAD
from robot_ident.signals.motion import Array, Mask

FAINT = 0.01  # weight of the piece that is left out: directions which it alone excites stay bounded
_RIDGE = 1e-10  # of a column's square, added: below the rank that identify itself asks for
_ROUNDS = 6  # of weights and scales, from the fit to everything
_FIRST_ROUNDS = 15
_STEP = 0.3  # of a scale, in one round
_BOUNDS = 0.2, 5.0  # of a scale


@dataclass(frozen=True)
class Grams:
    """Sums over rows by piece and joint: X'X [F, n, P, P], X'y [F, n, P], y'y [F, n] and their number [F, n]."""

    xx: Array
    xy: Array
    yy: Array
    rows: Array

    @classmethod
    def of(cls, columns: Array, torque: Array, piece: np.ndarray, used: Mask, pieces: int) -> Grams:
        """Return the sums of columns [N, n, P] and torque [N, n] over the rows used [N, n]; piece [N]: -1 for none."""
        n, p = columns.shape[1:]
        xx, xy = np.zeros((pieces, n, p, p)), np.zeros((pieces, n, p))
        yy, rows = np.zeros((2, pieces, n))
        for f in range(pieces):
            inside = piece == f
            for j in range(n):
                own = inside & used[:, j]
                x, y = columns[own, j], torque[own, j]
                xx[f, j], xy[f, j], yy[f, j], rows[f, j] = x.T @ x, x.T @ y, y @ y, len(y)
        return cls(xx, xy, yy, rows)

    def __add__(self, other: Grams) -> Grams:
        """Return the sums over the rows of both."""
        return Grams(self.xx + other.xx, self.xy + other.xy, self.yy + other.yy, self.rows + other.rows)

    def kept(self, columns: np.ndarray) -> Grams:
        """Return the sums with some of the columns alone."""
        return Grams(self.xx[:, :, columns[:, None], columns], self.xy[:, :, columns], self.yy, self.rows)


@dataclass(frozen=True)
class Fitted:
    """Parameters [P] and scales [n], and the variance [n] that they leave in a row; scale_spread [n]: standard error of
    the scales by what they are without one piece of the path or another (jackknife), whatever colour the rest has.
    """

    theta: Array
    scale: Array
    variance: Array
    scale_spread: Array | None = None

    def by_joint(self, rigid: Mask) -> Array:
        """Return the parameters [n, P] as each joint's rows take them, those of rigid columns [P] in its scale."""
        return np.asarray(np.where(rigid[None, :], self.scale[:, None] * self.theta, self.theta[None, :]))


def loss(grams: Grams, fitted: Fitted, rigid: Mask) -> Array:
    """Return the squared error [F, n] of parameters in every piece."""
    whole = fitted.by_joint(rigid)
    return np.asarray(
        grams.yy
        - 2.0 * np.sum(grams.xy * whole, axis=2)
        + np.sum(np.matmul(grams.xx, whole[:, :, None])[..., 0] * whole, axis=2)
    )


def fit(
    grams: Grams, weight: Array, independent: float, rigid: Mask, free: Mask, start: Fitted | None = None
) -> Fitted:
    """Return the least weighted squared error over pieces of weight [F], each joint by the variance that it leaves.

    independent: share of the rows that count as independent of each other. rigid [P]: columns that joints share.
    free [n]: joints whose scale is found, by Gauss-Newton, ln a ~ N(0, SPREAD^2); the others' is 1.
    """
    xx, xy = np.tensordot(weight, grams.xx, 1), np.tensordot(weight, grams.xy, 1)
    yy, rows = weight @ grams.yy, weight @ grams.rows
    n, p = xy.shape
    whole = Grams(xx[None], xy[None], yy[None], rows[None])
    theta, scale = (np.zeros(p), np.ones(n)) if start is None else (start.theta, start.scale)
    blank = (rows == 0.0) | (yy <= 0.0)  # joints that say nothing, and weigh nothing
    variance = np.where(blank, np.inf, yy / np.maximum(rows, 1.0)) if start is None else start.variance
    searched = np.flatnonzero(free & (rows > 0))
    for _ in range(_FIRST_ROUNDS if start is None else _ROUNDS):
        per = independent / variance
        d = np.where(rigid[None, :], scale[:, None], 1.0)
        h = np.tensordot(per, xx * (d[:, :, None] * d[:, None, :]) if len(searched) else xx, 1)
        r = per @ (d * xy)
        if not theta.any() or not len(searched):
            theta = _solved(h, r)
        else:  # a Y theta = a0 Y theta + (a - a0) Y theta0, and ln a0 + (a - a0) / a0 ~ N(0, SPREAD^2)
            shared = np.where(rigid, theta, 0.0)
            along = xx @ shared
            cross = (per[:, None] * d * along)[searched].T
            own = per * (along @ shared) + 1.0 / (SPREAD * scale) ** 2
            pull = per * (xy @ shared) - np.log(scale) / (SPREAD**2 * scale)
            both = np.block([[h, cross], [cross.T, np.diag(own[searched])]])
            step = _solved(both, np.concatenate([r, pull[searched]]))
            theta, scale, most = step[:p], scale.copy(), _STEP * scale[searched]
            scale[searched] = np.clip(scale[searched] + np.clip(step[p:], -most, most), *_BOUNDS)
        now = Fitted(theta, scale, variance)
        left = np.maximum(loss(whole, now, rigid)[0], 1e-9 * yy)
        variance = np.where(blank, np.inf, left / np.maximum(rows, 1.0))
    return Fitted(theta, scale, variance)


def _solved(h: Array, r: Array) -> Array:
    size = np.sqrt(np.maximum(np.diag(h), 1e-300))
    scaled = h / size / size[:, None] + _RIDGE * np.eye(len(h))
    return np.asarray(np.linalg.solve(scaled, r / size) / size)


def held_out(
    fitted: Grams, judged: Sequence[Grams], independent: float, rigid: Mask, free: Mask
) -> tuple[list[Array], Fitted]:
    """Return the squared error [F, n] in every piece of what the others give, by each that judges, and whole fit."""
    pieces = len(fitted.yy)
    everything = fit(fitted, np.ones(pieces), independent, rigid, free)
    out = [np.empty(one.yy.shape) for one in judged]
    scales = np.empty((pieces, len(free)))
    for f in range(pieces):
        weight = np.ones(pieces)
        weight[f] = FAINT
        without = fit(fitted, weight, independent, rigid, free, everything)
        scales[f] = without.scale
        for error, one in zip(out, judged, strict=True):
            error[f] = loss(one, without, rigid)[f]
    spread = np.sqrt((pieces - 1) * np.var(scales, axis=0))
    return out, replace(everything, scale_spread=spread)
