"""The state of the simulated arm as a vector, with names for its parts."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from robot_ident.signals.motion import Array


class Parts(NamedTuple):
    """The parts of a state.

    q rad, v rad/s, a rad/s^2: of the joints (their motors), then of links behind a transmission that gives; a is the
    mean acceleration of the last step, which predicts the next one. own: states of the phenomena. values: their
    parameters, which don't change.
    """

    q: Any
    v: Any
    a: Any
    own: Any
    values: Any


@dataclass(frozen=True)
class Layout:
    """Where the parts stand: three of n joints and `links` further links, `own` states and `values` parameters."""

    n: int
    own: int
    links: int = 0
    values: int = 0

    @property
    def moving(self) -> int:
        """Number of coordinates that move."""
        return self.n + self.links

    @property
    def size(self) -> int:
        """Length of a state."""
        return 3 * self.moving + self.own + self.values

    def _slices(self) -> list[slice]:
        m = self.moving
        edges = [0, m, 2 * m, 3 * m, 3 * m + self.own, self.size]
        return [slice(a, b) for a, b in pairwise(edges)]

    def split(self, states: Array) -> Parts:
        """Return the parts of a state [size] or of states [N, size]."""
        return Parts(*(states[..., part] for part in self._slices()))

    def joints(self, states: Array) -> Parts:
        """Return the parts with q, v, a of the joints alone."""
        parts = self.split(states)
        return parts._replace(q=parts.q[..., : self.n], v=parts.v[..., : self.n], a=parts.a[..., : self.n])

    def split_symbolic(self, state: Any) -> Parts:
        """Return the parts of a CasADi state."""
        return Parts(*(state[part] for part in self._slices()))

    def rest(self, q: Array, own: list[float], values: list[float]) -> Array:
        """Return the state at rest in a pose [moving]."""
        return np.concatenate([np.asarray(q, dtype=float), np.zeros(2 * self.moving), own, values])
