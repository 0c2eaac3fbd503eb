"""Bias and efficiency of the estimator over repeated noise (Swevers et al. 1997, section IV and Table II)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.least_squares import Factor, factor
from robot_ident.model.structure import Structure
from robot_ident.parallel import run_parallel
from robot_ident.signals.motion import Array, Motion

_BATCH = 250  # runs that a worker does at a time; fewer aren't worth a process


@dataclass(frozen=True)
class MonteCarlo:
    """What repeated identification gave beside what theory says.

    true, mean, sigma, sample_sigma [p]: true values, mean estimate, predicted and observed standard deviation.
    inside_mean: means within sigma / sqrt(runs) of the truth (the paper: 16 of 21). inside_ratio: ratios of sigma
    inside their 90 % interval (the paper: 19 of 21). bias_statistic = runs D' C^-1 D is chi-square with p degrees of
    freedom; error_statistic = mean of e' C^-1 e / p is 1.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    runs: int
    true: Array
    mean: Array
    sigma: Array
    sample_sigma: Array
    inside_mean: int
    inside_ratio: int
    ratio_interval: tuple[float, float]
    bias_statistic: float
    bias_interval: tuple[float, float]
    error_statistic: float
    error_interval: tuple[float, float]

    @property
    def holds(self) -> bool:
        """Whether both exact statistics lie inside their intervals (99.8 % and 3 sigma)."""
        bias = self.bias_interval[0] <= self.bias_statistic <= self.bias_interval[1]
        return bias and self.error_interval[0] <= self.error_statistic <= self.error_interval[1]

    def to_dict(self) -> dict[str, Any]:
        """Return what `montecarlo --json` prints."""
        listed = [
            {"name": n, "unit": u, "true": float(t), "mean": float(m), "sigma": float(s), "sample_sigma": float(o)}
            for n, u, t, m, s, o in zip(
                self.names, self.units, self.true, self.mean, self.sigma, self.sample_sigma, strict=True
            )
        ]
        return {
            "schema": "robot_ident/montecarlo/1",
            "runs": self.runs,
            "parameters": listed,
            "means_inside_68_percent": self.inside_mean,
            "sigma_ratios_inside_90_percent": self.inside_ratio,
            "sigma_ratio_interval": list(self.ratio_interval),
            "bias_statistic": self.bias_statistic,
            "bias_interval": list(self.bias_interval),
            "error_statistic": self.error_statistic,
            "error_interval": list(self.error_interval),
            "holds": self.holds,
        }


def montecarlo(motion: Motion, structure: Structure, variance: Array, *, runs: int = 200, seed: int = 0) -> MonteCarlo:
    """Identify `runs` times from the same motion with fresh torque noise of `variance` [n] per sample of the
    (averaged) period.

    Joint angles are exact, as in the paper. Raises InputError for fewer than 2 runs or noise that isn't positive.
    """
    from scipy.special import chdtri

    if runs < 2:
        raise InputError(f"--runs {runs}: at least 2 runs are needed")
    unknown = [joint for joint, known in zip(structure.robot.joints, variance > 0, strict=True) if not known]
    if unknown:
        raise InputError(
            f"{structure.robot.name}: the torque noise of {', '.join(unknown)} is unknown or zero: give torque_variance"
            " (Nm^2, of one sample; robot_ident info prints its root for a recording) under joints in the robot YAML"
        )
    columns = structure.columns(motion)
    rows = (columns / np.sqrt(variance)[:, None]).reshape(-1, columns.shape[2])  # in units of the noise
    solver = factor(rows, structure.names, "montecarlo")
    true = structure.true_values()
    covariance = solver.inverse_information()
    exact = rows @ true
    batches = [(seed, number, min(_BATCH, runs - first)) for number, first in enumerate(range(0, runs, _BATCH))]
    estimates = np.hstack(run_parallel(partial(_identified, solver=solver, exact=exact), batches))
    error = estimates - true[:, None]
    mean_error = error.mean(axis=1)
    sigma, sample = np.sqrt(np.diag(covariance)), estimates.std(axis=1, ddof=1)
    p = len(true)
    # The 90 % interval of sample over predicted sigma, by the paper's formula (its printed figures are a slip).
    root, scale = np.sqrt(2.0 * runs - 1.0), np.sqrt(2.0) * np.sqrt(runs - 1.0)
    low, high = float((root - 1.645) / scale), float((root + 1.645) / scale)
    ratio = sample / sigma
    statistic = float(np.mean(np.sum(error * np.linalg.solve(covariance, error), axis=0)) / p)
    three_sigma = 3.0 * float(np.sqrt(2.0 / (p * runs)))
    return MonteCarlo(
        names=structure.names,
        units=tuple(parameter.unit for parameter in structure.parameters),
        runs=runs,
        true=true,
        mean=estimates.mean(axis=1),
        sigma=sigma,
        sample_sigma=sample,
        inside_mean=int(np.sum(np.abs(mean_error) < sigma / np.sqrt(runs))),
        inside_ratio=int(np.sum((ratio > low) & (ratio < high))),
        ratio_interval=(low, high),
        bias_statistic=float(runs * mean_error @ np.linalg.solve(covariance, mean_error)),
        bias_interval=(float(chdtri(p, 0.999)), float(chdtri(p, 0.001))),
        error_statistic=statistic,
        error_interval=(1.0 - three_sigma, 1.0 + three_sigma),
    )


def _identified(batch: tuple[int, int, int], solver: Factor, exact: Array) -> Array:
    """Return the estimates [p, count] of a batch (seed, number, count) of runs; each batch has random numbers of its
    own.
    """
    seed, number, count = batch
    rng = np.random.default_rng([seed, number])
    return np.column_stack([solver.solve(exact + rng.standard_normal(len(exact))) for _ in range(count)])
