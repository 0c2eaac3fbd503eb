"""How far the parameters of single periods, and of single days, scatter beside the sigma that the noise explains, and
what drifts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any, ClassVar

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
class _Repeated:
    """Estimates [K, p] of one model from parts of its data, and the scatter [p] that the noise lets expect of them.

    least, chance: times that scatter, and probability by noise alone, beyond which a parameter's is remarkable.
    """

    values: Array
    expected: Array
    least: ClassVar[float]
    chance: ClassVar[float]

    @property
    def scatter(self) -> Array:
        """Standard deviation of the estimates [p]."""
        return np.std(self.values, axis=0, ddof=1)

    def by_parameter(self, names: Sequence[str], **columns: Array) -> dict[str, Any]:
        """Return the scatter, further columns [p] and the estimates of every parameter."""
        rows = enumerate(names)
        more = {"scatter": self.scatter, **columns}
        return {n: {**{c: float(x[k]) for c, x in more.items()}, "values": self.values[:, k].tolist()} for k, n in rows}

    @property
    def ratio(self) -> float:
        """Root mean square over the parameters of scatter over expected: 1 where noise alone makes estimates differ."""
        return float(np.sqrt(np.mean((self.scatter / self.expected) ** 2)))

    def restless(self, names: Sequence[str]) -> str:
        """Return the parameters whose scatter is remarkable, and how many times the expected one it is; or nothing."""
        from scipy.special import chdtri

        ratio, free = self.scatter / self.expected, len(self.values) - 1
        bound = max(self.least, float(np.sqrt(chdtri(free, self.chance / len(ratio)) / free)))
        return ", ".join(f"{names[k]} {ratio[k]:.2g} times" for k in np.argsort(-ratio) if ratio[k] > bound)


@dataclass(frozen=True)
class PerPeriod(_Repeated):
    """Estimates [M, p] from each period of one recording alone."""

    source: str
    drift: tuple[Drift, ...]
    least, chance = 1.25, 1e-4

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Return plain data for `model.yaml`; of_mean: what the scatter lets expect of the mean's sigma."""
        root = np.sqrt(len(self.values))
        return {
            "source": self.source,
            "periods": len(self.values),
            "scatter_over_sigma": self.ratio,
            "parameters": self.by_parameter(names, of_mean=self.scatter / root, sigma=self.expected / root),
            "drift": [asdict(drift) for drift in self.drift],
        }


def per_period(measurements: Sequence[Measurement], found: Solution, estimator: str) -> tuple[PerPeriod, ...]:
    """Return the estimates of single periods of every recording with at least three that excites all parameters by
    itself, at the motion of their mean.
    """
    out = []
    for measured in measurements:
        torques = measured.period_torque
        if torques is None or len(torques) < _LEAST:
            continue
        try:
            values, sigma = _estimates(measured, torques, found, weighted=estimator != "ls")
        except InputError:  # alone it does not excite all that the recordings do together: a stop that it never meets
            continue
        drift = _drifts(values, found, len(measurements))
        out.append(PerPeriod(values, sigma * np.sqrt(len(values)), measured.source, drift))
    return tuple(out)


def _linear(
    measurements: Sequence[Measurement], found: Solution, *, weighted: bool = True
) -> tuple[Problem, Equations]:
    """Return the linear problem of some of the measurements, inner parameters as all of them say, and its equations."""
    problem = Problem(measurements, found.structure, weighted=weighted)
    linear = found.values[: len(found.structure.parameters)]
    equations = problem.equations(found.structure, linear)
    return problem.beside(linear, equations) or problem, equations


def _sigma(problem: Problem, equations: Equations, values: Array, names: Sequence[str]) -> Array:
    """Return the standard deviations [p] of an estimate by linear least squares."""
    residual = equations.torque - equations.phi @ values
    return np.sqrt(np.diag(problem.covariance(equations, equations.phi, residual, names)))


def _estimates(measured: Measurement, torques: Array, found: Solution, *, weighted: bool) -> tuple[Array, Array]:
    """Return theta [M, p] of each period's torque [M, N, n], and the sigma [p] of their mean; gaps hold the mean's."""
    names = found.structure.names
    problem, equations = _linear([measured], found, weighted=weighted)
    solver = problem.factored(equations.phi, names)
    values = np.empty((len(torques), len(names)))
    for first in range(0, len(torques), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        whole = [measured.passed(np.where(np.isfinite(one), one, measured.torque)) for one in torques[some]]
        rows = np.column_stack([one[equations.sample, equations.joint] for one in whole])
        values[some] = solver.solve(problem.right(rows)).T
    return values, _sigma(problem, equations, values.mean(axis=0), names)


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
            phi = found.equations.phi[found.equations.joint == joint][:, own]
            friction, change = phi @ mean[own], phi @ slope[own] * (count - 1)
            size = float(friction @ friction)
            out.append(Drift(name, p_value, float(change @ friction) / size if size else 0.0))
    return tuple(out)


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
        if loud := one.restless(names):
            notes.append(
                f"{one.source}: the periods alone scatter more than the noise within a period explains, in {loud};"
                " trust that scatter, not sigma"
            )
    return tuple(notes)


@dataclass(frozen=True)
class Days(_Repeated):
    """Estimates [D, p] of each day alone; none where there are fewer than three days."""

    days: tuple[str, ...]
    least, chance = 2.0, 1e-3

    def notes(self, names: Sequence[str]) -> list[str]:
        """Return a line where days differ by more than the noise explains."""
        loud = self.restless(names) if len(self.values) else ""
        listed = f"{len(self.days)} days scatter more than sigma says, in {loud}: trust the scatter between days"
        return [listed] if loud else []

    def to_dict(self, names: Sequence[str]) -> dict[str, Any]:
        """Return plain data for `model.yaml`."""
        days = list(self.days)
        if not len(self.values):
            return {"days": days, "intervals": "this day only", "scatter_over_sigma": None, "parameters": {}}
        parameters = self.by_parameter(names, sigma=self.expected)
        return {"days": days, "intervals": "all days", "scatter_over_sigma": self.ratio, "parameters": parameters}


def _day_of(measured: Measurement) -> str:
    """Return the day of a recording: as its conditions state it, else that of its first stamp (UTC), else nothing."""
    stamp = datetime.fromtimestamp(max(measured.start_ns, 0) / 1e9, UTC).date().isoformat()
    return measured.conditions.day or (stamp if measured.start_ns > 0 else "")


def by_day(measurements: Sequence[Measurement], found: Solution) -> Days:
    """Return the estimates of the single days, where there are three or more and each excites all by itself."""
    groups: dict[str, list[Measurement]] = {}
    for measured in measurements:
        groups.setdefault(_day_of(measured), []).append(measured)
    known = tuple(sorted(day for day in groups if day))
    nothing = Days(np.zeros((0, 0)), np.zeros(0), known)
    if len(known) < _LEAST or "" in groups:
        return nothing
    names, values, sigma = found.structure.names, [], []
    try:
        for day in known:
            problem, equations = _linear(groups[day], found)
            values.append(problem.factored(equations.phi, names).solve(problem.right(equations.torque)))
            sigma.append(_sigma(problem, equations, values[-1], names))
    except InputError:  # a day alone does not excite all that the days do together
        return nothing
    return Days(np.array(values), np.sqrt(np.mean(np.array(sigma) ** 2, axis=0)), known)
