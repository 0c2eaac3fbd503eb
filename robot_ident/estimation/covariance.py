"""Covariance of an estimate whose weights are not the inverse of its noise, or whose noise is not known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.estimation.equations import Equations
from robot_ident.estimation.row_noise import RowNoise
from robot_ident.signals.motion import Array

_LEAST = 0.25  # of the scores' variance were rows independent: a short recording's own spectrum has fewer directions


def sandwich(
    bread: Array, weighed: Array, residual: Array, equations: Equations, noise: RowNoise, unknown: Sequence[int]
) -> Array:
    """Return B M B with B = bread [p, p] and M the covariance of the scores.

    weighed [R, p]: weights times the derivatives of torque, whose products with the noise are the scores. Measurements
    with known noise give X' S X; `unknown` ones the residual's own spectrum at zero, heteroscedasticity and
    autocorrelation included, and no direction better known than by half of the sigma of independent rows.
    """
    scale, power, vectors = scaled_eigen(long_run_scores(weighed, residual, equations, noise, unknown))
    half = bread @ (scale[:, None] * vectors * np.sqrt(np.maximum(power, 0.0)))  # symmetric however nearly singular
    return np.asarray(half @ half.T)


def scaled_eigen(covariance: Array) -> tuple[Array, Array, Array]:
    """Return the standard deviations [p] of a covariance, 1 where there is none, and the eigenvalues [p] and
    eigenvectors [p, p] of the correlation: unlike units must not hide what is small.
    """
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    power, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale, power, vectors


def long_run_scores(
    weighed: Array, residual: Array, equations: Equations, noise: RowNoise, unknown: Sequence[int]
) -> Array:
    """Return the covariance M [p, p] of the scores X' n for X = weighed [R, p]."""
    known = ~np.isin(equations.block, list(unknown))
    spread = noise.multiply(weighed * known[:, None])
    meat: Array = weighed.T @ (spread * known[:, None])
    plain = meat.copy()
    for block in unknown:
        rows = equations.block == block
        single = weighed[rows] * residual[rows, None]
        alone = single / np.sqrt(equations.independent[rows, None])
        plain += alone.T @ alone
        # summed over joints and over bins as long as the low pass smears noise
        bins = equations.sample[rows] // max(1, round(1.0 / float(np.mean(equations.independent[rows]))))
        scores = np.zeros((int(bins.max()) + 1, weighed.shape[1]))
        np.add.at(scores, bins, single)
        values = len(scores) * len(np.unique(equations.joint[rows]))
        # the fit has taken T n / (T n - p) from the residual
        meat = meat + long_run(scores) * (values / max(values - weighed.shape[1], 1))
    return _at_least(meat, _LEAST * plain) if len(unknown) else meat


def _at_least(meat: Array, least: Array) -> Array:
    """Return `meat` [p, p] raised to `least` in the directions in which it is below."""
    scale, power, vectors = scaled_eigen(least)
    half = np.sqrt(np.maximum(power, 1e-14 * power[-1]))
    root, inverse = vectors * half, vectors / half
    inner = inverse.T @ (meat / np.outer(scale, scale)) @ inverse
    size, turn = np.linalg.eigh(0.5 * (inner + inner.T))
    raised = root @ (turn * np.maximum(size, 1.0)) @ turn.T @ root.T
    return np.asarray(raised * np.outer(scale, scale))


def long_run(scores: Array) -> Array:
    """Return sum over lags of k(lag / S) sum_t g_t g_(t + lag)' for scores g [T, p]: heteroscedasticity and
    autocorrelation consistent.

    Quadratic spectral kernel with the bandwidth S that an AR(1) of every score suggests (Andrews, "Heteroskedasticity
    and autocorrelation consistent covariance matrix estimation", 1991, eqs. 2.7, 6.2 and 6.4).
    """
    total, p = scores.shape
    scale = np.sqrt(np.mean(scores**2, axis=0))
    scaled = scores / np.where(scale > 0, scale, 1.0)
    before, after = scaled[:-1], scaled[1:]
    rho = np.sum(before * after, axis=0) / np.maximum(np.sum(before**2, axis=0), 1e-300)
    rho = np.clip(rho, -0.97, 0.97)
    innovation = np.mean((after - rho * before) ** 2, axis=0)
    top = np.sum(4.0 * rho**2 * innovation**2 / (1.0 - rho) ** 8)
    bottom = np.sum(innovation**2 / (1.0 - rho) ** 4)
    bandwidth = 1.3221 * (max(float(top / max(bottom, 1e-300)), 1e-6) * total) ** 0.2
    x = np.arange(1, total) / bandwidth
    angle = 6.0 * np.pi * x / 5.0
    spectral = 25.0 / (12.0 * np.pi**2 * x**2) * (np.sin(angle) / angle - np.cos(angle))
    weights = np.concatenate([[1.0], spectral])
    # sum_lag k(lag) sum_t g_t g_(t+lag)' as a product with the Toeplitz matrix of k, by FFT of twice the length
    size = 2 * total
    kernel = np.zeros(size)
    kernel[:total], kernel[size - total + 1 :] = weights, weights[:0:-1]
    smooth = np.fft.irfft(np.fft.rfft(scores, size, axis=0) * np.real(np.fft.rfft(kernel))[:, None], size, axis=0)
    found = scores.T @ smooth[:total]
    return np.asarray(0.5 * (found + found.T))
