"""Normal equations of least squares, solved where the data leave directions open."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.signals.motion import Array

_OPEN = 1e-11  # of the largest eigenvalue of the scaled Gram matrix: below, the data leave a direction open
_DEPENDENT = 1e-8  # of the largest eigenvalue, likewise, of a few candidates' columns


def least_squares(rows: Sequence[Array], targets: Sequence[Array]) -> Array:
    """Return the x [p] of least sum |y - A x|^2 over parts A [M, p], y [M], without directions that they leave open.

    By A'A and A'y, and once more for what that leaves (iterative refinement), which takes off their rounding.
    """
    inverse = pseudo_inverse(np.sum([a.T @ a for a in rows], axis=0))
    x = inverse @ np.sum([a.T @ y for a, y in zip(rows, targets, strict=True)], axis=0)
    more = np.sum([a.T @ (y - a @ x) for a, y in zip(rows, targets, strict=True)], axis=0)
    return np.asarray(x + inverse @ more)


def pseudo_inverse(square: Array) -> Array:
    """Return the pseudo-inverse of a normal matrix, its columns scaled to one first."""
    scale = np.sqrt(np.maximum(np.diag(square), 1e-300))
    values, vectors = np.linalg.eigh(square / scale[:, None] / scale)
    told = values > _OPEN * values[-1]
    root = vectors[:, told] / np.sqrt(values[told]) / scale[:, None]
    return np.asarray(root @ root.T)


def least_gains(square: Array, right: Array) -> Array:
    """Return r' S^+ r [H] of many small normal equations S [H, k, k], r [H, k], without directions that S leaves open:
    by how much the squared error falls.
    """
    values, vectors = np.linalg.eigh(square)
    told = values > _DEPENDENT * values[:, -1:]
    along = np.einsum("hab,ha->hb", vectors, right)
    return np.asarray(np.sum(np.where(told, along**2 / np.where(told, values, 1.0), 0.0), axis=1))


def least_solution(square: Array, right: Array) -> Array:
    """Return the smallest x that solves a small normal equation S x = r, without directions that S leaves open."""
    values, vectors = np.linalg.eigh(square)
    told = values > _DEPENDENT * values[-1]
    return np.asarray((vectors[:, told] / values[told]) @ (vectors[:, told].T @ right))
