"""Columns of all hypotheses in the rows of one joint, with their inner products by fold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.signals.motion import Array

_ROOM = 64  # columns by which a pool grows at least


class GramPool:
    """Whitened columns x of one joint's rows, fold by fold, and x'x, b'x, x'y with the base b and the torque y.

    A column of a joint is zero in other joints' rows, so that inner products of one joint stay in its pool. own [F, P,
    P], cross [F, p, P], torque [F, P]; F folds, p base parameters, P columns.
    """

    def __init__(self, base: Sequence[Array], y: Sequence[Array]) -> None:
        """Begin without columns; base [N, p] and y [N] of every fold."""
        self.base, self.y, self.count = list(base), list(y), 0
        self._rows: list[Array] = []
        self._grow(0)

    def _grow(self, room: int) -> None:
        folds, p, used = len(self.base), self.base[0].shape[1], self.count
        rows = [np.zeros((len(y), room)) for y in self.y]
        own, cross, torque = np.zeros((folds, room, room)), np.zeros((folds, p, room)), np.zeros((folds, room))
        if used:
            for new, old in zip(rows, self._rows, strict=True):
                new[:, :used] = old[:, :used]
            own[:, :used, :used] = self.own
            cross[:, :, :used] = self.cross
            torque[:, :used] = self.torque
        self._rows, self._own, self._cross, self._torque = rows, own, cross, torque

    def add(self, columns: Sequence[Array]) -> Array:
        """Add columns [N, k] of every fold; return their places [k]."""
        low, high = self.count, self.count + columns[0].shape[1]
        if high > self._own.shape[1]:
            self._grow(max(high, self.count + _ROOM))
        for fold, new in enumerate(columns):
            rows = self._rows[fold]
            rows[:, low:high] = new
            products = rows[:, :high].T @ new
            self._own[fold, :high, low:high] = products
            self._own[fold, low:high, :high] = products.T
            self._cross[fold, :, low:high] = self.base[fold].T @ new
            self._torque[fold, low:high] = new.T @ self.y[fold]
        self.count = high
        return np.arange(low, high)

    def rows(self, fold: int, places: Array | slice) -> Array:
        """Return the columns [N, k] at some places in a fold's rows."""
        return self._rows[fold][:, : self.count][:, places]

    @property
    def own(self) -> Array:
        """Inner products of the columns [F, P, P]."""
        return self._own[:, : self.count, : self.count]

    @property
    def cross(self) -> Array:
        """Inner products with the base [F, p, P]."""
        return self._cross[:, :, : self.count]

    @property
    def torque(self) -> Array:
        """Inner products with the torque [F, P]."""
        return self._torque[:, : self.count]
