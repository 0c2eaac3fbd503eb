"""Friction with memory: springs in parallel, each of which is dragged along once it is stretched to its reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class MaxwellSlip:
    """Elements with equal shares of a force level, which slip at `reaches` (Iwan 1966; Al-Bender et al. 2005).

    Element i holds its stretch z_i in [-reach_i, reach_i] and follows the joint in between: a play operator, exact for
    steps of any length. It dissipates whatever the motion, and depends on the path alone, not on speed.
    """

    level: Any
    reaches: Sequence[Any]

    def stretched(self, stretch: Sequence[Any], moved: Any) -> list[Any]:
        """Return the stretches after the joint has moved."""
        return [ca.fmax(ca.fmin(z + moved, reach), -reach) for z, reach in zip(stretch, self.reaches, strict=True)]

    def force(self, stretch: Sequence[Any]) -> Any:
        """Return the force against the motion."""
        share = self.level / len(self.reaches)
        return sum((share * z / reach for z, reach in zip(stretch, self.reaches, strict=True)), start=0.0)

    def stiffness(self, stretch: Sequence[Any], moved: Any) -> Any:
        """Return how the force rises with the motion: of elements that don't slip."""
        share = self.level / len(self.reaches)
        return sum(
            (
                ca.if_else(ca.fabs(z + moved) < reach, share / reach, 0)
                for z, reach in zip(stretch, self.reaches, strict=True)
            ),
            start=0.0,
        )
