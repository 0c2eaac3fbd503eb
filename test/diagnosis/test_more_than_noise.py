"""Is it more than noise? Never said of noise alone, whatever its colour and the low pass; said of what is small."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from robot_ident.estimation.identify import estimate
from robot_ident.recording import Processing, Recording, process
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import gather
from robot_ident.regression.gram import base_gram
from robot_ident.regression.misfit import lack_of_fit
from robot_ident.regression.more_than_noise import ALPHA, Share, _moments, noise_tests
from robot_ident.residuals.comparison import compare
from robot_ident.signals.motion import Array

SEEDS = range(3)
GAINS = {
    "white": lambda f: np.ones_like(f),
    "falling": lambda f: 0.1 + 1.0 / np.sqrt(1.0 + (f / 5.0) ** 2),
    "resonant": lambda f: 1.0 + 4.0 * np.exp(-(((f - 20.0) / 3.0) ** 2)),
}


def noisy(quiet: Recording, sigma: Array, colour: str, seed: int) -> Recording:
    """Return a recording with torque noise of a standard deviation [n] and a colour."""
    white = np.random.default_rng(seed).normal(size=quiet.tau.shape)
    gain = GAINS[colour](np.fft.rfftfreq(len(white), 1 / 150))
    noise = np.fft.irfft(np.fft.rfft(white, axis=0) * gain[:, None], len(white), axis=0)
    return replace(quiet, tau=quiet.tau + sigma * noise / noise.std(axis=0))


@pytest.mark.parametrize(("colour", "low_pass"), [("white", 10.0), ("resonant", None)])
def test_noise_alone_is_no_misfit(bench: Any, colour: str, low_pass: float | None) -> None:
    processing = Processing(periodic=True, low_pass=low_pass)
    sigma = np.sqrt(bench.robot.noise.torque_variance)
    quiet = [bench.record((), motion, noise=1e-6) for motion in (0, 1, 2)]

    def measured(seed: int) -> list[Measurement]:
        return [
            process(noisy(one, sigma, colour, 10 * seed + k), bench.robot, processing) for k, one in enumerate(quiet)
        ]

    own, unseen, fitted = [], [], []
    for seed in SEEDS:
        *training, other = measured(seed)
        model = estimate(training, bench.structure, processing=processing)
        own += [joint.misfit for joint in compare(model, training).joints]
        unseen += [joint.misfit for joint in compare(model, [other]).joints]
        evidence = gather(training, bench.structure)
        fitted += list(lack_of_fit(evidence, base_gram(evidence)))
    for found in (own, unseen, fitted):
        assert min(test.p_value for test in found) > ALPHA
        assert np.mean([test.statistic for test in found]) == pytest.approx(1.0, abs=0.03 if low_pass is None else 0.08)


@pytest.mark.parametrize(
    ("rate", "size", "band"), [(0.7, 2.8, "0 to 1 Hz"), (8.0, 2.8, "5 to 15 Hz"), (40.0, 5.0, "above 15 Hz")]
)
def test_a_small_line_is_found_in_its_band(bench: Any, rate: float, size: float, band: str) -> None:
    """A few Nm beside a noise of 14 Nm a sample."""
    quiet = bench.record((), 0, noise=1e-6)
    added = quiet.tau + [0.0, size, 0.0] * np.sin(2.0 * np.pi * rate * quiet.t)[:, None]
    sigma = 0.7 * np.sqrt(bench.robot.noise.torque_variance)
    measured = [
        process(noisy(one, sigma, "white", seed), bench.robot)
        for seed, one in ((1, replace(quiet, tau=added)), (2, bench.record((), 1, noise=1e-6)))
    ]
    evidence = gather(measured, bench.structure)
    one, two, three = lack_of_fit(evidence, base_gram(evidence))
    assert two.fails
    assert two.band == band
    assert not one.fails
    assert not three.fails


def test_what_a_fit_takes_is_counted_by_band() -> None:
    """Mean and spread of |A z|^2 over some rows of a projection, against drawing them."""
    rng = np.random.default_rng(5)
    q, _ = np.linalg.qr(rng.normal(size=(60, 7)))
    rows = slice(0, 15)
    mean, dof = _moments([q[rows]], -np.eye(7), 15.0)
    e = rng.normal(size=(60, 40000))
    power = np.sum((e - q @ (q.T @ e))[rows] ** 2, axis=0)
    assert mean == pytest.approx(power.mean(), rel=0.01)
    assert dof == pytest.approx(2.0 * mean**2 / power.var(), rel=0.03)


def test_a_fit_that_does_not_whiten_is_counted_as_well(bench: Any) -> None:
    """The residual of plain least squares under coloured noise, whitened: as large as is said, band by band."""
    sigma = np.sqrt(bench.robot.noise.torque_variance)
    quiet = bench.record((), 0, noise=1e-6)
    first = gather([process(noisy(quiet, sigma, "falling", 0), bench.robot)], bench.structure)
    assert first.trajectories[0].measured.noise.coloured[0]
    (q,) = [np.linalg.qr(phi.reshape(-1, phi.shape[2]))[0].reshape(phi.shape) for phi in first.phi]
    share = Share.of_fit(first, [q])
    assert share.twice
    t, n = first.trajectories[0], bench.robot.n
    statistics = []
    for seed in range(40):
        noise = noisy(replace(quiet, tau=0.0 * quiet.tau), sigma, "falling", 100 + seed).tau
        e = noise.reshape(6, -1, n).mean(axis=0) * t.weight
        r = e - (q @ np.einsum("tjk,tj->k", q, e))
        statistics.append([test.statistic for test in noise_tests(first, [r], share)])
    assert np.mean(statistics) == pytest.approx(1.0, abs=0.02)


def test_what_is_no_number_never_passes_for_fit(bench: Any) -> None:
    evidence = gather(bench.measure((), noise=1.0), bench.structure)
    spoilt = [rows.copy() for rows in evidence.residual]
    spoilt[1][7, 2] = np.nan
    with pytest.raises(FloatingPointError):
        noise_tests(evidence, spoilt, Share.of_fit(evidence, evidence.phi))
