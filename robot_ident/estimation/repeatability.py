"""How far the parameters of single periods, and of single days, scatter beside the sigma that the noise explains, and
what drifts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.problem import Problem, Solution
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_FRICTION = ("viscous", "coulomb")
_AT_ONCE = 32  # periods that are solved together
_LEAST = 3  # periods, below which neither scatter nor drift can be judged
_ALPHA = 1e-3  # of the test for drift, divided by the number of joints and recordings


@dataclass(frozen=True)
class Drift:
    """Change of a joint's friction over the periods of a recording.

    change: of the friction's torque from the first to the last period, as a share of it; p_value of no trend.
    """

    joint: str
    p_value: float
    change: float


@dataclass(frozen=True)
class PerPeriod:
    """Estimates [M, p] from each period of one recording alone.

    scatter [p]: their standard deviation; of_mean [p]: that over sqrt(M), to be held beside the averaged sigma.
    """

    source: str
    values: Array
    sigma: Array
    drift: tuple[Drift, ...]

    @property
    def scatter(self) -> Array:
        """Standard deviation of the estimates of single periods [p]."""
        return np.std(self.values, axis=0, ddof=1)

    @property
    def of_mean(self) -> Array:
        """What that scatter lets expect of the mean's standard deviation [p]."""
        return self.scatter / np.sqrt(len(self.values))

    @property
    def ratio(self) -> float:
        """Root mean square of scatter / sqrt(M) over the averaged sigma: 1 where noise alone makes periods differ."""
        return float(np.sqrt(np.mean((self.of_mean / self.sigma) ** 2)))

    def restless(self) -> list[tuple[int, float]]:
        """Return the parameters whose scatter exceeds what sigma says by a quarter and by chance, and how far."""
        from scipy.special import chdtri

        count, p = self.values.shape
        ratio = self.of_mean / self.sigma
        bound = max(1.25, float(np.sqrt(chdtri(count - 1, 1e-4 / p) / (count - 1))))
        return [(int(k), float(ratio[k])) for k in np.argsort(-ratio) if ratio[k] > bound]

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        return {
            "source": self.source,
            "periods": len(self.values),
            "scatter_over_sigma": self.ratio,
            "parameters": {
                name: {
                    "scatter": float(s),
                    "of_mean": float(m),
                    "sigma": float(g),
                    "values": [float(v) for v in column],
                }
                for name, s, m, g, column in zip(
                    names, self.scatter, self.of_mean, self.sigma, self.values.T, strict=True
                )
            },
            "drift": [{"joint": d.joint, "p_value": d.p_value, "change": d.change} for d in self.drift],
        }


def per_period(measurements: Sequence[Measurement], found: Solution, estimator: str) -> tuple[PerPeriod, ...]:
    """Return the estimates of single periods of every recording with at least three that excites all parameters by
    itself, at the motion of their mean.
    """
    out = []
    p = len(found.structure.parameters)
    for measured in measurements:
        if measured.period_torque is None or len(measured.period_torque) < _LEAST:
            continue
        try:
            values, sigma = _estimates(measured, found, estimator)
        except InputError:  # alone it does not excite all that the recordings do together: a stop that it never meets
            continue
        drift = _drifts(values, found, len(measurements))
        out.append(PerPeriod(measured.source, values[:, :p], sigma, drift))
    return tuple(out)


def _estimates(measured: Measurement, found: Solution, estimator: str) -> tuple[Array, Array]:
    """Return theta [M, p] of each period by linear least squares, and the sigma [p] of their mean."""
    problem = Problem([measured], found.structure, weighted=estimator != "ls")
    linear = found.values[: len(found.structure.parameters)]
    equations = problem.equations(found.structure, linear)
    problem = problem.beside(linear, equations) or problem
    solver = problem.factored(equations.phi, found.structure.names)
    torques = measured.period_torque
    assert torques is not None
    values = np.empty((len(torques), len(linear)))
    for first in range(0, len(torques), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        rows = np.column_stack([_rows(measured, one, equations) for one in torques[some]])
        values[some] = solver.solve(problem.right(rows)).T
    residual = equations.torque - equations.phi @ values.mean(axis=0)
    covariance = problem.covariance(equations, equations.phi, residual, found.structure.names)
    return values, np.sqrt(np.diag(covariance))


def _rows(measured: Measurement, torque: Array, equations: Equations) -> Array:
    """Return one period's torque [N, n] at the rows of the equations [R]; gaps hold the mean period's."""
    whole = measured.passed(np.where(np.isfinite(torque), torque, measured.torque))
    out: Array = whole[equations.sample, equations.joint]
    return out


def _drifts(values: Array, found: Solution, recordings: int) -> tuple[Drift, ...]:
    """Return the joints whose friction has a trend: regressed on the period's number, F test of all slopes."""
    from scipy.special import fdtrc

    structure, count = found.structure, len(values)
    mean = values.mean(axis=0)
    number = np.arange(count) - (count - 1) / 2.0
    slope = number @ values / np.sum(number**2)
    rest = values - mean - np.outer(number, slope)
    out = []
    for joint, name in enumerate(structure.robot.joints):
        own = [k for k, p in enumerate(structure.parameters) if p.joint == name and p.effect in _FRICTION]
        if not own or count < len(own) + 3:
            continue
        covariance = rest[:, own].T @ rest[:, own] / (count - 2)
        if np.linalg.matrix_rank(covariance) < len(own):  # periods without any scatter: a simulation without noise
            continue
        statistic = float(slope[own] @ np.linalg.solve(covariance, slope[own]) * np.sum(number**2))
        freedom = count - 1 - len(own)
        # Hotelling's T^2 of a slope whose covariance has M - 2 degrees of freedom
        p_value = float(fdtrc(len(own), freedom, statistic * freedom / (len(own) * (count - 2))))
        if p_value < _ALPHA / (structure.robot.n * recordings):
            out.append(Drift(name, p_value, _change(found, own, joint, slope * (count - 1), mean)))
    return tuple(out)


def _change(found: Solution, own: Sequence[int], joint: int, change: Array, mean: Array) -> float:
    """Return the mean change of friction over the rows of a joint, as a share of the friction."""
    phi = found.equations.phi[found.equations.joint == joint][:, own]
    size = np.sum((phi @ mean[list(own)]) ** 2)
    return float((phi @ change[list(own)]) @ (phi @ mean[list(own)]) / size) if size else 0.0


def drift_notes(periods: Sequence[PerPeriod], names: Sequence[str]) -> tuple[str, ...]:
    """Return a line for each joint that drifts, and one where periods differ by more than the noise."""
    notes = []
    for one in periods:
        for drift in one.drift:
            word = "falls" if drift.change < 0 else "rises"
            notes.append(
                f"{one.source}: the friction of {drift.joint} {word} by {100 * abs(drift.change):.2g} % from the first"
                f" period to the last (p = {drift.p_value:.1g}): warm up before recording, or add the effect:"
                f" temperature_drift@{drift.joint}"
            )
        loud = one.restless()
        if loud:
            notes.append(
                f"{one.source}: the periods alone scatter more than the noise within a period explains, in"
                f" {', '.join(f'{names[k]} {size:.2g} times' for k, size in loud)}; trust that scatter, not sigma"
            )
    return tuple(notes)


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
