"""What pairs of hypotheses on one joint gain by the score test: those that are worth a look at motion left out."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from robot_ident.diagnosis.selection.hypotheses import Hypothesis
from robot_ident.regression.normal_equations import least_solution
from robot_ident.signals.motion import Array

_APART = 1e-6  # of a column's square, by which two must differ to be told apart


class PairScores:
    """Gains of pairs on one joint by the score test, the best values of each pair of labels."""

    def __init__(self, square: Array, right: Array, size: Array, joint: int, live: Collection[Hypothesis]) -> None:
        self.square, self.right, self.size, self.joint = square, right, size, joint
        self._best: dict[tuple[str, str], tuple[float, Hypothesis, Hypothesis]] = {}
        of_size: dict[int, list[Hypothesis]] = {}
        for h in live:
            of_size.setdefault(len(h.ranges), []).append(h)
        self._of_single_columns(of_size.get(1, []))
        for count, several in of_size.items():
            for mine in several if count > 1 else ():
                for fewer in (size for size in of_size if size <= count):
                    self._with_several(mine, of_size[fewer])

    def best(self, count: int) -> list[tuple[Hypothesis, Hypothesis]]:
        """Return the pairs of the largest gains."""
        found = sorted(self._best.values(), key=lambda entry: -entry[0])
        return [(a, b) for _, a, b in found[:count]]

    def _put(self, gain: float, a: Hypothesis, b: Hypothesis) -> None:
        if not a.excludes(b):
            key = (a.label, b.label) if a.label < b.label else (b.label, a.label)
            if key not in self._best or gain > self._best[key][0]:
                self._best[key] = (gain, a, b)

    def _of_single_columns(self, one: Sequence[Hypothesis]) -> None:
        if len(one) < 2:
            return
        at = np.array([h.at[self.joint][0] for h in one])
        s, r = self.square[np.ix_(at, at)], self.right[at]
        d = np.diag(s)
        determinant = d[:, None] * d - s**2
        apart = determinant > _APART * d[:, None] * d
        gains = r[:, None] ** 2 * d - 2.0 * r[:, None] * r * s + r**2 * d[:, None]
        gains = np.where(apart, gains / np.where(apart, determinant, 1.0), 0.0)
        labels, which = np.unique([h.label for h in one], return_inverse=True)
        members = [np.flatnonzero(which == k) for k in range(len(labels))]
        for k, mine in enumerate(members):
            for others in members[:k]:
                block = gains[np.ix_(mine, others)]
                i, j = np.unravel_index(int(np.argmax(block)), block.shape)
                self._put(float(block[i, j]), one[mine[i]], one[others[j]])

    def _with_several(self, several: Hypothesis, others: Sequence[Hypothesis]) -> None:
        """Score a hypothesis of several columns beside others, which all have as many columns as each other."""
        mine = several.at[self.joint]
        own = self.square[np.ix_(mine, mine)]
        onto = least_solution(own, self.square[mine])
        right = self.right - onto.T @ self.right[mine]
        gain = float(self.right[mine] @ least_solution(own, self.right[mine]))
        at = np.array([h.at[self.joint] for h in others])
        left = self.square[at[:, :, None], at[:, None, :]]
        left = left - np.einsum("kha,khb->hab", self.square[mine][:, at], onto[:, at])
        own_left = np.einsum("haa->ha", left)
        open_ = own_left > _APART * self.size[at]
        scale = np.where(open_, 1.0 / np.sqrt(np.where(open_, own_left, 1.0)), 0.0)
        shares = np.linalg.pinv(left * scale[:, :, None] * scale[:, None, :], rcond=_APART, hermitian=True)
        scaled = right[at] * scale
        for h, more in zip(others, np.einsum("ha,hab,hb->h", scaled, shares, scaled), strict=True):
            self._put(gain + float(more), several, h)
