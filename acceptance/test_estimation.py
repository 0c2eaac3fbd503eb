"""Estimation by brute force: intervals, bias, efficiency and the noise estimate, over hundreds of recordings.

Run by `make acceptance`; about ten minutes on two cores. ROBOT_IDENT_RUNS changes the number of runs.
"""

from __future__ import annotations

import faulthandler
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.signal import lfilter

from robot_ident.estimation.solve import solve
from robot_ident.model.structure import Structure
from robot_ident.recording import Measurement, Processing, Recording, process
from robot_ident.recording.noise_spectrum import NoiseSpectrum
from robot_ident.robot import load_robot
from robot_ident.trajectories.fourier_series import FourierSeries

RUNS = int(os.environ.get("ROBOT_IDENT_RUNS", "500"))
WORKERS = max(1, min(4, os.cpu_count() or 1))
RATE, BASE, SAMPLES = 150.0, 0.1, 1500
POLE = 0.8  # of the coloured noise
CONVERTER = 2.0**-11  # of the largest torque: a step of the 12-bit converter


@dataclass(frozen=True)
class Case:
    """One column of the table."""

    periods: int
    coloured: bool

    @property
    def name(self) -> str:
        return f"{self.periods} period{'s' if self.periods > 1 else ''}, {'coloured' if self.coloured else 'white'}"


@cache
def plant() -> tuple[Structure, FourierSeries, np.ndarray]:
    """Return the robot's structure, the motion, and the exact torque of one period."""
    structure = Structure.build(load_robot())
    rng = np.random.default_rng(1)
    a, b = 0.25 * rng.normal(size=(2, 3, 5))
    series = FourierSeries(BASE, np.array([0.0, 0.2, -0.3]), a, b)
    t = np.arange(SAMPLES) / RATE
    return structure, series, structure.columns(series.motion(t)) @ structure.true_values()


def record(case: Case, seed: int) -> Recording:
    """Record steady periods: torque noise, position noise, the steps of encoder and torque converter."""
    structure, series, exact = plant()
    robot = structure.robot
    rng = np.random.default_rng(seed)
    count = SAMPLES * case.periods
    noise = rng.normal(size=(count + 200, 3))
    if case.coloured:
        noise = lfilter([np.sqrt(1 - POLE**2)], [1.0, -POLE], noise, axis=0)
    # a single period has the noise of an averaged one, as in the paper
    size = np.sqrt(robot.noise.torque_variance / (16 if case.periods == 1 else 1))
    tau = np.tile(exact, (case.periods, 1)) + noise[200:] * size
    step = CONVERTER * robot.limits.torque
    tau = np.round(tau / step) * step
    t = np.arange(count) / RATE
    q = np.tile(series.motion(t[:SAMPLES]).q, (case.periods, 1))
    q = q + rng.normal(size=q.shape) * np.sqrt(robot.noise.position_variance)
    q = np.round(q / robot.drives.encoder_step) * robot.drives.encoder_step
    return Recording(robot.joints, t, q, tau, source="run")


def measure(case: Case, seed: int) -> Measurement:
    """Return a processed recording; of a single period the noise is known beforehand, as in the paper's section IV."""
    structure = plant()[0]
    recording = record(case, seed)
    options = Processing(base_frequency=BASE, periodic=True)
    if case.periods > 1:
        return process(recording, structure.robot, options)
    # two passes of the positions, so that their noise shows; their average has that of one pass
    exact = plant()[1].motion(recording.t).q
    q = np.tile(exact, (2, 1)) + np.sqrt(2.0) * (
        np.vstack([recording.q, record(case, seed + 1_000_000).q]) - np.tile(exact, (2, 1))
    )
    tau = np.tile(recording.tau, (2, 1))
    made = process(Recording(recording.names, np.arange(2 * SAMPLES) / RATE, q, tau), structure.robot, options)
    known = structure.robot.noise.torque_variance / 16
    rounding = (CONVERTER * structure.robot.limits.torque) ** 2 / 12.0
    return replace(
        made,
        torque_variance=known,
        averages=1.0,
        noise=spectrum(known) if case.coloured else None,
        quantisation=rounding,
        period_torque=None,
    )


def spectrum(variance: np.ndarray) -> NoiseSpectrum:
    """Return the true spectrum of the coloured noise: that of a first-order autoregression."""
    z = np.exp(-2j * np.pi * np.arange(SAMPLES // 2 + 1) / SAMPLES)
    shape = (1.0 - POLE**2) / np.abs(1.0 - POLE * z) ** 2
    density = (shape[:, None, None] * np.diag(variance)).astype(complex)
    return NoiseSpectrum(density, SAMPLES, np.inf, (True,) * len(variance), False, variance, np.inf)


def one_run(job: tuple[Case, int]) -> dict[str, tuple[np.ndarray, np.ndarray, float]]:
    """Return error, covariance and chi-square per degree of freedom of both estimators."""
    case, seed = job
    structure = plant()[0]
    measured = measure(case, seed)
    out = {}
    for estimator in ("wls", "ml"):
        found = solve([measured], structure, estimator)
        out[estimator] = (found.values - structure.true_values(), found.covariance, found.chi_square / found.dof)
    return out


def bound(case: Case) -> np.ndarray:
    """Return the Cramer-Rao bound [p, p] for the true noise, joint angles exact."""
    structure, series, _ = plant()
    columns = structure.columns(series.motion(np.arange(SAMPLES) / RATE))
    information = np.zeros((columns.shape[2],) * 2)
    for joint, variance in enumerate(structure.robot.noise.torque_variance / 16):
        phi = columns[:, joint]
        if case.coloured:
            lag = np.arange(SAMPLES)
            factor = cho_factor(variance * toeplitz(POLE**lag + POLE ** (SAMPLES - lag) * (lag > 0)))
            information += phi.T @ cho_solve(factor, phi)
        else:
            information += phi.T @ phi / variance
    return np.linalg.inv(information)


CASES = [Case(1, False), Case(1, True), Case(16, False), Case(16, True)]


@cache
def results(case: Case) -> list[dict[str, tuple[np.ndarray, np.ndarray, float]]]:
    """Return what every run of a case gave."""
    faulthandler.cancel_dump_traceback_later()  # pytest's time limit for a hanging test, not for 500 runs
    print(f"\nestimation, {case.name}: {RUNS} runs by wls and ml, about two minutes on two cores at 500 runs")
    with ProcessPoolExecutor(WORKERS) as pool:
        return list(pool.map(one_run, [(case, seed) for seed in range(RUNS)], chunksize=5))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
@pytest.mark.parametrize("estimator", ["wls", "ml"])
def test_intervals_hold(case: Case, estimator: str) -> None:
    runs = [result[estimator] for result in results(case)]
    error = np.array([run[0] for run in runs])
    sigma = np.sqrt([np.diag(run[1]) for run in runs])
    p = error.shape[1]
    coverage = float(np.mean(np.abs(error) < 1.959964 * sigma))
    distance = float(np.mean([e @ np.linalg.solve(c, e) / p for e, c, _ in runs]))
    best = bound(case)
    efficiency = float(np.mean(np.diag(best) / np.mean(error**2, axis=0)))
    bias = error.mean(axis=0)
    statistic = float(len(runs) * bias @ np.linalg.solve(best, bias))
    print(
        f"\n{case.name:20s} {estimator:4s} coverage of 95 % intervals {100 * coverage:6.2f} %   mean normalised error"
        f" {distance:.3f}   efficiency {efficiency:.3f}   bias statistic {statistic:.1f} ({p} expected)"
    )
    tolerance = np.sqrt(500 / len(runs)) if len(runs) < 500 else 1.0
    assert abs(coverage - 0.95) < 0.015 * tolerance
    assert abs(distance - 1.0) < 0.03 * tolerance
    assert efficiency > 1.0 - 0.03 * tolerance


@pytest.mark.parametrize("case", [case for case in CASES if case.periods > 1], ids=lambda case: case.name)
def test_noise_estimate_is_unbiased(case: Case) -> None:
    """Chi-square per degree of freedom of a correct model."""
    ratio = np.array([result["wls"][2] for result in results(case)[:200]])
    print(f"\n{case.name:20s} chi-square / dof {ratio.mean():.4f} +- {ratio.std() / len(ratio) ** 0.5:.4f}")
    assert abs(ratio.mean() - 1.0) < 0.01 * (1.0 if len(ratio) >= 200 else np.sqrt(200 / len(ratio)))
