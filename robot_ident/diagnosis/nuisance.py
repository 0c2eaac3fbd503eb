"""Nuisance columns K whose coefficients h are known beforehand to be 0 +- 1: they count as noise of covariance K K'.

The least of |r - K h|^2 + |h|^2 over h is r' (I + K K')^-1 r, so that whatever is fitted beside them is fitted to
W r, W = (I + K K')^(-1/2), by columns W phi: a base of p columns stays one of p, however many the nuisance has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Nuisance:
    """Columns K [M, k] that the trajectories at `places` share, their rows of all joints stacked: M = n sum N."""

    places: tuple[int, ...]
    columns: Array

    @classmethod
    def of(cls, places: Sequence[int], parts: Sequence[Array]) -> Nuisance:
        """Return the nuisance with the columns [N, n, k] of each place."""
        return cls(tuple(places), np.concatenate([part.reshape(-1, part.shape[2]) for part in parts]))

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Eigenvalues s [k] of K' K and its eigenvectors V [k, k]."""
        values, vectors = np.linalg.eigh(self.columns.T @ self.columns)
        return np.maximum(values, 1e-12 * max(float(values[-1]), 1e-300)), vectors

    def whitened(self, parts: Sequence[Array]) -> list[Array]:
        """Return W x for x given by place, each [N, n, c] or [N, n]."""
        s = self._axes[0]
        root = np.sqrt(1.0 + s)
        return self._less(parts, 1.0 / (root * (1.0 + root)))  # (1 - 1 / root) / s

    def without(self, parts: Sequence[Array]) -> list[Array]:
        """Return x - K h by place, h = (I + K' K)^-1 K' x: what the nuisance most likely has not made."""
        return self._less(parts, 1.0 / (1.0 + self._axes[0]))

    def _less(self, parts: Sequence[Array], shares: Array) -> list[Array]:
        """Return x - K V diag(shares) V' K' x by place."""
        mine, vectors = [parts[place] for place in self.places], self._axes[1]
        x = np.concatenate([part.reshape(part.shape[0] * part.shape[1], -1) for part in mine])
        x = x - self.columns @ (vectors @ (shares[:, None] * (vectors.T @ (self.columns.T @ x))))
        ends = np.cumsum([part.shape[0] * part.shape[1] for part in mine])
        return [piece.reshape(part.shape) for piece, part in zip(np.split(x, ends[:-1]), mine, strict=True)]


def through(groups: Sequence[Nuisance], parts: Sequence[Array], *, whitened: bool) -> tuple[Array, ...]:
    """Return parts [N, n] or [N, n, c] of all trajectories, each whitened by, or without, the nuisance of its group."""
    out = list(parts)
    for group in groups:
        made = group.whitened(parts) if whitened else group.without(parts)
        for place, part in zip(group.places, made, strict=True):
            out[place] = part
    return tuple(out)
