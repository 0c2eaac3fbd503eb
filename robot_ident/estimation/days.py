"""The days one by one: how far the parameters of single days scatter, beside the sigma that the noise explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.problem import Problem, Solution
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_LEAST = 3  # days, below which nothing is known of how they differ
_TWICE = 2.0  # of what sigma lets expect
_CHANCE = 1e-3  # that a parameter is called restless where noise alone makes days differ


@dataclass(frozen=True)
class Days:
    """Estimates [D, p] of each day alone, with their sigma [D, p]; none where there are fewer than three days."""

    days: tuple[str, ...]
    values: Array
    sigma: Array

    @property
    def enough(self) -> bool:
        """Whether the days tell how they differ."""
        return len(self.values) >= _LEAST

    @property
    def scatter(self) -> Array:
        """Standard deviation of the days' estimates [p]."""
        return np.std(self.values, axis=0, ddof=1)

    @property
    def expected(self) -> Array:
        """What the noise of each day lets expect of it [p]."""
        return np.sqrt(np.mean(self.sigma**2, axis=0))

    @property
    def ratio(self) -> float:
        """Root mean square over the parameters of scatter over expected: 1 where noise alone makes days differ."""
        return float(np.sqrt(np.mean((self.scatter / self.expected) ** 2)))

    def restless(self) -> list[int]:
        """Return the parameters that scatter more than twice what sigma says, and more than by chance."""
        from scipy.special import chdtri

        ratio, free = self.scatter / self.expected, len(self.values) - 1
        bound = max(_TWICE, float(np.sqrt(chdtri(free, _CHANCE / len(ratio)) / free)))
        return [int(k) for k in np.argsort(-ratio) if ratio[k] > bound]

    def notes(self, names: Sequence[str]) -> list[str]:
        """Return a line where days differ by more than the noise explains."""
        loud = self.restless() if self.enough else []
        if not loud:
            return []
        ratio = self.scatter / self.expected
        listed = ", ".join(f"{names[k]} {ratio[k]:.2g} times" for k in loud)
        return [f"{len(self.days)} days scatter more than sigma says, in {listed}: trust the scatter between days"]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        data: dict[str, Any] = {"days": list(self.days), "intervals": "all days" if self.enough else "this day only"}
        if not self.enough:
            return {**data, "scatter_over_sigma": None, "parameters": {}}
        rows = zip(names, self.scatter, self.expected, self.values.T, strict=True)
        parameters = {
            name: {"scatter": float(s), "sigma": float(e), "values": [float(v) for v in values]}
            for name, s, e, values in rows
        }
        return {**data, "scatter_over_sigma": self.ratio, "parameters": parameters}


def day_of(measured: Measurement) -> str:
    """Return the day of a recording: as its conditions state it, else that of its first stamp (UTC), else nothing."""
    if measured.conditions.day:
        return measured.conditions.day
    if measured.start_ns <= 0:
        return ""
    return datetime.fromtimestamp(measured.start_ns / 1e9, UTC).date().isoformat()


def by_day(measurements: Sequence[Measurement], found: Solution) -> Days:
    """Return the estimates of the single days, where there are three or more and each excites all by itself."""
    groups: dict[str, list[Measurement]] = {}
    for measured in measurements:
        groups.setdefault(day_of(measured), []).append(measured)
    known = tuple(sorted(day for day in groups if day))
    nothing = Days(known, np.zeros((0, 0)), np.zeros((0, 0)))
    if len(known) < _LEAST or "" in groups:
        return nothing
    try:
        estimates = [_estimate(groups[day], found) for day in known]
    except InputError:  # a day alone does not excite all that the days do together
        return nothing
    values, sigma = (np.array(part) for part in zip(*estimates, strict=True))
    return Days(known, values, sigma)


def _estimate(measurements: Sequence[Measurement], found: Solution) -> tuple[Array, Array]:
    """Return theta [p] and sigma [p] of one day by linear least squares, inner parameters as all days say."""
    problem = Problem(measurements, found.structure)
    linear = found.values[: len(found.structure.parameters)]
    equations = problem.equations(found.structure, linear)
    problem = problem.beside(linear, equations) or problem
    names = found.structure.names
    values = problem.factored(equations.phi, names).solve(problem.right(equations.torque))
    covariance = problem.covariance(equations, equations.phi, equations.torque - equations.phi @ values, names)
    return values, np.sqrt(np.diag(covariance))
