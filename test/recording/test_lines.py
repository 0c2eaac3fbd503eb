"""Lines of a position: what stands above the noise, and how much of the rest is motion."""

from __future__ import annotations

import numpy as np

from robot_ident.signals.fourier import Lines, above_noise, evaluate, lines_of_grid, share_of_motion
from robot_ident.signals.motion import Array, Mask

SAMPLES, SIGMA = 1500, 1e-5
FREQUENCY = 0.1


def of_measured(q: Array) -> tuple[Lines, Mask, Array]:
    """Return lines [K + 1, n], which stand above the noise, and the shares, of positions [N, n]."""
    lines = lines_of_grid(q)
    variance = np.full(q.shape[1], SIGMA**2)
    strong = above_noise(lines, variance, SAMPLES)
    return lines, strong, share_of_motion(lines, strong, variance, SAMPLES)


def shaken(rng: np.random.Generator, joints: int) -> Array:
    """Return positions [N, n] whose lines fall with the square of frequency through the noise."""
    k = np.arange(1, 750)[:, None]
    lines = np.zeros((751, joints), dtype=complex)
    lines[1:750] = (
        (rng.standard_normal((749, joints)) + 1j * rng.standard_normal((749, joints))) * 5e-6 * (100 / k) ** 2
    )
    return evaluate(lines, SAMPLES, FREQUENCY)


def test_noise_alone_is_no_motion() -> None:
    rng, joints = np.random.default_rng(0), 2000
    t = np.arange(SAMPLES)[:, None] / SAMPLES
    q = 0.5 * np.sin(2 * np.pi * 3 * t) + SIGMA * rng.standard_normal((SAMPLES, joints))
    _, strong, share = of_measured(q)
    assert np.array_equal(np.flatnonzero(strong.all(axis=1)), [0, 3])
    false = np.any((share > 0) & ~strong, axis=0)
    assert false.sum() <= 3  # 2000 joints at a chance of 1e-4: more than 3 have one of 6e-5
    assert (np.flatnonzero((share > 0).any(axis=1))).max() < 60  # what is false is slow, where it does no harm


def test_faint_lines_bring_the_acceleration_nearer_to_the_true_one() -> None:
    rng = np.random.default_rng(1)
    q = shaken(rng, 40)
    lines, strong, share = of_measured(q + SIGMA * rng.standard_normal(q.shape))
    true = evaluate(lines_of_grid(q), SAMPLES, FREQUENCY, 2)

    def wrong(held: Lines) -> float:
        return float(np.mean((evaluate(held, SAMPLES, FREQUENCY, 2) - true) ** 2))

    assert wrong(share * lines) < 0.8 * wrong(strong * lines)
    assert wrong(share * lines) < 0.2 * wrong(lines)


def test_shares_are_those_of_wiener() -> None:
    """r / (1 + r), r the ratio of the powers of motion and noise in a band; the error left is that share of noise."""
    rng = np.random.default_rng(2)
    q = shaken(rng, 300)
    measured, strong, share = of_measured(q + SIGMA * rng.standard_normal(q.shape))
    true, noise = lines_of_grid(q), 4 * SIGMA**2 / SAMPLES
    band = slice(126, 151)
    ratio = np.mean(np.abs(true[band]) ** 2) / noise
    assert not strong[band].all()
    assert abs(np.mean(share[band]) - ratio / (1 + ratio)) < 0.05
    error = np.abs(share * measured - true)[band] ** 2
    assert abs(np.mean(error) / (noise * np.mean(share[band])) - 1) < 0.15
