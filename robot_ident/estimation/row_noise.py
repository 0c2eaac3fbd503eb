"""The noise of the stacked rows: independent, coloured or shared by joints, and what it makes of an estimate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.estimation.equations import Equations
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

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
