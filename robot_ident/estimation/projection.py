"""What a model leaves of the torque while inner parameters are searched: columns that stay are factorised once.

Variable projection needs, for every trial of the inner parameters s, the residual b - F(s) theta(s) at the best linear
parameters. Most columns don't depend on s: with F = [A, B(s)] and A = Q R, a trial factorises B - Q Q' B alone.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.least_squares import Factor
from robot_ident.estimation.problem import Problem
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Projection:
    """A problem in which the inner parameters of some effects are searched.

    near [p]: linear parameters whose torque other effects see meanwhile, None where none does. order [p]: columns that
    stay, then those that move. stays: the factorisation of the former, None where every trial is solved as a whole.
    """

    problem: Problem
    near: Array | None
    order: np.ndarray
    stays: Factor | None

    @classmethod
    def of(cls, problem: Problem, structure: Structure, searched: Collection[str]) -> Projection:
        """Take up a search over the inner parameters of the effects whose labels are given."""
        moves = structure.places_of(lambda effect: effect.label in searched or effect.uses_torque)
        order = np.concatenate([np.flatnonzero(~moves), np.flatnonzero(moves)])
        try:
            near = problem.linear(structure)[0] if structure.uses_torque else None
            held = order[: int(np.sum(~moves))]
            phi = problem.equations(structure, near).phi[:, held]
            stays = problem.factored(phi, [problem.names[k] for k in held])
        except InputError:  # the motion doesn't excite a column; with other inner parameters it may
            return cls(problem, None, order, None)
        return cls(problem, near, order, stays)

    def residual(self, structure: Structure) -> Array:
        """Return the whitened residual [R] at theta(s); InputError where the motion doesn't excite a column."""
        if self.stays is None:
            values, _, equations = self.problem.linear(structure)
        else:
            equations = self.problem.equations(structure, self.near)
            moving = equations.phi[:, self.order[len(self.stays.scale) :]]
            names = [self.problem.names[k] for k in self.order]
            factored = self.stays.beside(self.problem.right(moving), names, self.problem.source)
            values = np.empty(len(self.order))
            values[self.order] = factored.solve(self.problem.right(equations.torque))
        return self.problem.noise.whiten(equations.torque - equations.phi @ values)
