"""Weighted least squares on stacked equations by QR factorisation, the noise of their rows (independent, coloured or
shared by joints), and the covariance of an estimate whose weights need not be the inverse of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.equations import Equations
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_RANK = 1e-10  # singular values below this share of the largest (columns scaled to norm 1) count as zero


@dataclass(frozen=True)
class Factor:
    """A QR factorisation of weighted rows W^1/2 F, columns scaled to norm 1: what every solution of one F shares.

    condition_number: s_max / s_min of that matrix, the paper's c1.
    """

    q: Array
    r: Array
    scale: Array
    condition_number: float

    def solve(self, torque: Array) -> Array:
        """Return theta [p] (or [p, runs]) for the torque [R] (or [R, runs]), weighted as the rows are."""
        from scipy.linalg import solve_triangular

        return np.asarray((solve_triangular(self.r, self.q.T @ torque).T / self.scale).T)

    def solve_beside(self, further: Array, names: Sequence[str], source: str, torque: Array) -> Array:
        """Return theta [p + k] of a torque [R] with further columns G [R, k], what is known of F as it is; names: of
        all p + k.

        [F, G] = [Q, Q2] [[R, Q' G], [0, R2]] with Q2 R2 = G - Q Q' G. InputError as `factor`.
        """
        from scipy.linalg import solve_triangular

        scaled, scale = _scaled(further, names[len(self.scale) :], source)
        shared = self.q.T @ scaled
        rest = scaled - self.q @ shared
        again = self.q.T @ rest  # once more: what rounding has left along Q
        q, r = np.linalg.qr(rest - self.q @ again)
        whole = np.block([[self.r, shared + again], [np.zeros((len(r), len(self.r))), r]])
        _condition_number(whole, names, source)
        right = np.concatenate([self.q.T @ torque, q.T @ torque])
        return np.asarray(solve_triangular(whole, right) / np.concatenate([self.scale, scale]))

    def inverse_information(self) -> Array:
        """Return (F' W F)^-1 [p, p]."""
        from scipy.linalg import solve_triangular

        half = solve_triangular(self.r, np.eye(len(self.r))) / self.scale[:, None]
        return np.asarray(half @ half.T)


def factor(rows: Array, names: Sequence[str], source: str) -> Factor:
    """Factorise weighted rows W^1/2 F [R, p]; InputError names the columns where F lacks rank."""
    scaled, scale = _scaled(rows, names, source)
    q, r = np.linalg.qr(scaled)
    return Factor(q, r, scale, _condition_number(r, names, source))


def _scaled(phi: Array, names: Sequence[str], source: str) -> tuple[Array, Array]:
    """Return columns of norm 1 and the norms that they had; InputError names those without one."""
    scale = np.linalg.norm(phi, axis=0)
    silent = [name for name, size in zip(names, scale, strict=True) if size == 0.0]
    if silent:
        raise InputError(
            f"{source}: the motion does not excite {', '.join(silent)}; move the joints that it depends on"
        )
    return phi / scale, scale


def _condition_number(r: Array, names: Sequence[str], source: str) -> float:
    """Return s_max / s_min of a triangular factor [p, p]; InputError names the columns that depend on each other."""
    _, singular, vectors = np.linalg.svd(r)
    if singular[-1] < _RANK * singular[0]:
        blame = [names[k] for k in np.argsort(-np.abs(vectors[-1])) if abs(vectors[-1][k]) > 0.1]
        raise InputError(
            f"{source}: the data can't tell {', '.join(blame)} apart: their columns depend on each other;"
            " excite more joints or drop an effect"
        )
    return float(singular[0] / singular[-1])


def held_softly(rows: Array, right: Array, towards: Array, spread: float) -> Array:
    """Return x [p] that minimises |rows x - right|^2 + |x_k - towards|^2 / spread^2, x_k its last k elements."""
    p, k = rows.shape[1], len(towards)
    size = np.linalg.norm(rows, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    stacked = np.vstack([rows, np.eye(k, p, p - k) / spread]) / size
    found, *_ = np.linalg.lstsq(stacked, np.concatenate([right, towards / spread]), rcond=None)
    return np.asarray(found / size)


_ROWS = 750  # of a block whose rows are whitened together; colour reaches over far fewer
_NOT_NOISE = 2.0  # times the variance of the noise, above which a residual is mainly what the model lacks


@dataclass(frozen=True)
class Block:
    """Rows [r] of the equations whose noise is correlated, and the lower Cholesky factor [r, r] of its covariance.

    weighs: whether its inverse weighs the rows, or their variances alone do.
    """

    rows: np.ndarray
    cholesky: Array
    weighs: bool = True


@dataclass(frozen=True)
class Passband:
    """Rows of a low-passed measurement whose noise is not white: their places (time, joint) on the period's grid."""

    measurement: Measurement
    rows: np.ndarray
    place: tuple[np.ndarray, np.ndarray]

    def multiply(self, x: Array) -> Array:
        """Return S x for x [r, p]."""
        measured = self.measurement
        assert measured.noise is not None and measured.low_pass is not None
        grid = np.zeros((measured.noise.samples, len(measured.joints), x.shape[1]))
        grid[self.place] = x
        spread = measured.noise.multiply(measured.low_pass.apply(grid))
        return np.asarray(measured.low_pass.apply(spread)[self.place] / measured.averages)


@dataclass(frozen=True)
class RowNoise:
    """Covariance S [R, R] of the rows: diagonal but for blocks that are correlated in time or across joints.

    variance [R] (Nm)^2: the diagonal. independent [R]: share of rows with independent noise where a low pass smeared
    white noise; it counts as variance / independent there. blocks: without a low pass, coloured. bands: with one.
    """

    variance: Array
    independent: Array
    blocks: tuple[Block, ...] = ()
    bands: tuple[Passband, ...] = ()

    @property
    def weighs(self) -> bool:
        """Whether the inverse of S weighs every row."""
        return not self.bands and all(block.weighs for block in self.blocks)

    def beside(self, residual: Array, equations: Equations) -> RowNoise:
        """Return the same noise without the weight of its colour in measurements whose residual [R] is not that noise.

        Whitening looks hardest where the noise is least; where the model lacks something, it would fit the parameters
        to what is lacking there, and joints share parameters.
        """
        ratio = residual**2 / self.variance
        coloured = {int(equations.block[one.rows[0]]) for one in self.blocks}
        loud = [
            block for block in coloured if any(np.mean(ratio[rows]) > _NOT_NOISE for rows in equations.of_joints(block))
        ]
        blocks = (replace(one, weighs=int(equations.block[one.rows[0]]) not in loud) for one in self.blocks)
        return replace(self, blocks=tuple(blocks))

    @property
    def spread(self) -> Array:
        """Variance [R] that counts, the smearing of a low pass included."""
        return self.variance / self.independent

    def whiten(self, x: Array) -> Array:
        """Return W^1/2 x for x [R, ...], S^-1/2 x where S weighs, the smearing of a low pass left in."""
        from scipy.linalg import solve_triangular

        out: Array = (x.T / np.sqrt(self.variance)).T
        for block in (one for one in self.blocks if one.weighs):
            out[block.rows] = solve_triangular(block.cholesky, x[block.rows], lower=True, check_finite=False)
        return out

    def weigh(self, x: Array) -> Array:
        """Return W^1/2 x for x [R, ...] as least squares counts it, the smearing of a low pass taken into account."""
        return np.asarray((self.whiten(x).T * np.sqrt(self.independent)).T)

    def precision(self, x: Array) -> Array:
        """Return the weights that wls gives, W x for x [R, p]: S^-1 x where S is known in blocks, else x / spread."""
        from scipy.linalg import cho_solve

        out: Array = x / self.spread[:, None]
        for block in (one for one in self.blocks if one.weighs):
            out[block.rows] = cho_solve((block.cholesky, True), x[block.rows], check_finite=False)
        return out

    def multiply(self, x: Array) -> Array:
        """Return S x for x [R, p]."""
        out: Array = x * self.spread[:, None]
        for block in self.blocks:
            out[block.rows] = block.cholesky @ (block.cholesky.T @ x[block.rows])
        for band in self.bands:
            out[band.rows] = band.multiply(x[band.rows])
        return out


def row_noise(measurements: Sequence[Measurement], equations: Equations, variance: Array) -> RowNoise:
    """Return the noise of stacked equations with variances [R], from the spectra of their measurements."""
    blocks: list[Block] = []
    bands: list[Passband] = []
    for number, measured in enumerate(measurements):
        spectrum = measured.noise
        if spectrum is None or spectrum.white:
            continue
        rows = np.flatnonzero(equations.block == number)
        if measured.low_pass is not None:
            place = equations.sample[rows] * measured.decimate, equations.joint[rows]
            bands.append(Passband(measured, rows, place))
        else:
            blocks += _blocks(measured, equations, rows)
    return RowNoise(variance, equations.independent, tuple(blocks), tuple(bands))


def _blocks(measured: Measurement, equations: Equations, rows: np.ndarray) -> list[Block]:
    """Return the blocks of one measurement: joints together where they share noise, else each coloured one alone."""
    from scipy.linalg import cholesky

    spectrum = measured.noise
    assert spectrum is not None
    joints = range(len(measured.joints))
    groups = [list(joints)] if spectrum.correlated else [[j] for j in joints if spectrum.coloured[j]]
    lagged = spectrum.autocovariance() / measured.averages
    if measured.quantisation is not None:
        lagged[0] += np.diag(measured.quantisation)
    out = []
    for group in groups:
        own = rows[np.isin(equations.joint[rows], group)]
        own = own[np.lexsort((equations.joint[own], equations.sample[own]))]
        for part in np.array_split(own, max(1, int(np.ceil(len(own) / _ROWS)))):
            time, joint = equations.sample[part] * measured.decimate, equations.joint[part]
            lag = (time[None, :] - time[:, None]) % spectrum.samples
            covariance = lagged[lag, joint[:, None], joint[None, :]]
            # a spectrum that falls to nothing is held at 1e-4 of its mean, lest its lines rule
            floor = 1e-4 * float(np.mean(np.diag(covariance))) * np.eye(len(covariance))
            out.append(Block(part, cholesky(covariance + floor, lower=True, check_finite=False)))
    return out


_LEAST = 0.25  # of the scores' variance were rows independent: a short recording's own spectrum has fewer directions


def sandwich(
    bread: Array, weighed: Array, residual: Array, equations: Equations, noise: RowNoise, unknown: Sequence[int]
) -> Array:
    """Return B M B with B = bread [p, p] and M the covariance of the scores.

    weighed [R, p]: weights times the derivatives of torque, whose products with the noise are the scores. Measurements
    with known noise give X' S X; `unknown` ones the residual's own spectrum at zero, heteroscedasticity and
    autocorrelation included, and no direction better known than by half of the sigma of independent rows.
    """
    half = bread @ root_of(long_run_scores(weighed, residual, equations, noise, unknown))
    return np.asarray(half @ half.T)  # symmetric however nearly singular


def scaled_eigen(covariance: Array) -> tuple[Array, Array, Array]:
    """Return the standard deviations [p] of a covariance, 1 where there is none, and the eigenvalues [p] and
    eigenvectors [p, p] of the correlation: unlike units must not hide what is small.
    """
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    power, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale, power, vectors


def root_of(covariance: Array) -> Array:
    """Return R [p, p] with R R' = C; parameters of very different size keep their digits."""
    scale, power, vectors = scaled_eigen(covariance)
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(power, 0.0)))


def information_root(covariance: Array, least: float) -> Array:
    """Return R [p, p] with R' R = C^-1; directions of less than `least` times the largest spread count as so wide."""
    scale, power, vectors = scaled_eigen(covariance)
    return np.asarray((vectors / np.sqrt(np.maximum(power, least * max(float(power[-1]), least)))).T / scale)


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
    return at_least(meat, _LEAST * plain) if len(unknown) else meat


def at_least(meat: Array, least: Array) -> Array:
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
    from scipy.linalg import matmul_toeplitz

    total = len(scores)
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
    found = scores.T @ matmul_toeplitz(weights, scores)
    return np.asarray(0.5 * (found + found.T))
