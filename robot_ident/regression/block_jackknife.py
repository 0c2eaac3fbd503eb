"""How well least squares know their parameters whatever the model lacks: by leaving out half a second at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array

_BLOCK = 0.5
"""s; errors of a model farther apart are taken as independent: the correlation time of what slow formulas leave."""

_RIDGE = 1e-9  # of a column's square, added: what one block alone excites stays bounded without it


def rows_in_block(measured: Measurement) -> int:
    """Return how many rows of a measurement half a second takes."""
    return max(1, round(_BLOCK / (measured.dt * measured.decimate)))


def half_seconds(measurements: Sequence[Measurement], number: np.ndarray, sample: np.ndarray) -> np.ndarray:
    """Return which half second [R] of which recording rows belong to, the same in all groups of periods of one; number,
    sample [R]: their measurement, and their place in it.
    """
    sources = [measured.source for measured in measurements]
    place = sample // np.array([rows_in_block(measured) for measured in measurements])[number]
    return np.asarray(np.array([sources.index(one) for one in sources])[number] * (1 + place.max()) + place)


def block_jackknife(
    jacobian: Array, weighed: Array, residual: Array, blocks: np.ndarray, before: Array | None = None
) -> Array:
    """Return the covariance [p, p] of parameters by leaving out one block of rows at a time.

    Without block k of B the estimate moves by d_k = (G - G_k)^-1 s_k, G = J' W J, s_k = J_k' (W r)_k; the covariance is
    (B - 1) / B sum_k (d_k - d) (d_k - d)', d their mean (Efron and Stein 1981). With few blocks their sandwich is too
    small (MacKinnon and White 1985). It counts noise and what the model lacks alike. jacobian [R, p]: derivatives of
    torque; weighed [R, p]: the same times the weights; residual [R]; blocks [R]: which block a row belongs to; before
    [p, p]: information that the rows don't tell, in every G.
    """
    order = np.argsort(blocks, kind="stable")
    rows = np.split(order, np.flatnonzero(np.diff(blocks[order])) + 1)
    grams = np.array([jacobian[own].T @ weighed[own] for own in rows])
    scores = np.array([weighed[own].T @ residual[own] for own in rows])
    whole = grams.sum(axis=0) + (0.0 if before is None else before)
    scale = np.sqrt(np.maximum(np.diag(whole), 1e-300))
    without = (whole - grams) / np.outer(scale, scale)
    without = 0.5 * (without + without.swapaxes(1, 2)) + _RIDGE * np.eye(len(scale))
    moved = np.linalg.solve(without, (scores / scale)[:, :, None])[:, :, 0]
    spread = (moved - moved.mean(axis=0)) / scale
    return np.asarray((len(rows) - 1) / len(rows) * (spread.T @ spread))
