"""How much a motion tells about the parameters: determinant and condition number as the paper defines them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.excitation.excitation import Excitation
    from robot_ident.model.structure import Structure

PERIODS = 16  # periods that the paper averages
_OPEN = 1e-6  # of a direction that no torque tells: a part of it that is no rounding
ASSUMED_NOISE = 0.01  # of the torque limit, where a robot gives no noise variance


class Evaluation(NamedTuple):
    """What a motion tells: log10 of the determinant of the covariance, condition number, standard deviations [p]."""

    log10_det_covariance: float
    condition_number: float
    sigma: Array


def _weighted(columns: Array, variances: Array) -> tuple[Array, Array]:
    """Return S^-1/2 F [N n, p] with columns of length one, and their lengths [p]."""
    weighted = (columns / np.sqrt(variances)[:, None]).reshape(-1, columns.shape[-1])
    length = np.linalg.norm(weighted, axis=0)
    return weighted / np.where(length > 0, length, 1.0), length


def _singular_values(normalised: Array) -> Array:
    values = np.linalg.svd(normalised, compute_uv=False)
    rounding = values[0] * max(normalised.shape) * np.finfo(float).eps
    return np.asarray(np.where(values > rounding, values, 0.0))


def log10_det_covariance(columns: Array, variances: Array) -> float:
    """Return log10 det (F' S^-1 F)^-1 (Swevers et al. 1997, eq. 9); inf where parameters can't be told apart.

    columns F [N, n, p], variances [n] (Nm)^2 of the noise of those N rows.
    """
    normalised, length = _weighted(columns, variances)
    values = _singular_values(normalised)
    if len(values) < len(length) or not np.all(values > 0) or not np.all(length > 0):
        return float("inf")
    return float(-2.0 * (np.log10(values).sum() + np.log10(length).sum()))


def condition_number(columns: Array, variances: Array) -> float:
    """Return s_max / s_min of S^-1/2 F with columns divided by their length; inf where it hasn't full rank.

    columns F [N, n, p], variances [n] (Nm)^2.
    """
    normalised, length = _weighted(columns, variances)
    values = _singular_values(normalised)
    if len(values) < len(length) or values[-1] == 0.0 or not np.all(length > 0):
        return float("inf")
    return float(values[0] / values[-1])


def standard_deviations(columns: Array, variances: Array) -> Array:
    """Return the standard deviations [p] of the estimate, sqrt diag (F' S^-1 F)^-1; inf where it hasn't full rank."""
    normalised, length = _weighted(columns, variances)
    _, values, vt = np.linalg.svd(normalised, full_matrices=False)
    if len(values) < len(length) or not np.isfinite(log10_det_covariance(columns, variances)):
        return np.full(len(length), np.inf)
    return np.asarray(np.linalg.norm(vt / values[:, None], axis=0) / length)


def untold(columns: Array, variances: Array) -> Array:
    """Return which parameters [p] a motion leaves open: those that some direction v with F v = 0 moves.

    columns F [N, n, p], variances [n] (Nm)^2.
    """
    normalised, length = _weighted(columns, variances)
    _, values, vt = np.linalg.svd(np.linalg.qr(normalised, mode="r"), full_matrices=True)
    rounding = values[0] * max(normalised.shape) * np.finfo(float).eps
    rank = int(np.count_nonzero(values > rounding))
    return np.asarray((np.abs(vt[rank:]) > _OPEN).any(axis=0) | (length == 0))


def noise_variances(robot: Robot) -> tuple[Array, tuple[str, ...]]:
    """Return the variance [n] of one torque sample's noise, and notes on what had to be assumed.

    A joint whose noise is unknown is weighted as if it were 1 % of its torque limit. Raises InputError where that is
    unknown too, or where a variance is zero.
    """
    variances, notes = np.array(robot.noise.torque_variance), []
    for k, joint in enumerate(robot.joints):
        if np.isnan(variances[k]):
            limit = robot.limits.torque[k]
            if not np.isfinite(limit):
                raise InputError(
                    f"{robot.source}: joint {joint!r} has neither torque noise nor a torque limit to weight it by;"
                    " give torque_variance: under joints in a robot YAML"
                )
            variances[k] = (ASSUMED_NOISE * limit) ** 2
            notes.append(
                f"torque noise of {joint} is unknown: weighted as {ASSUMED_NOISE:.0%} of its limit of {limit:g}"
            )
        elif variances[k] <= 0:
            raise InputError(
                f"{robot.source}: torque_variance of joint {joint!r} = {variances[k]:g}; it must be positive"
            )
    return variances, tuple(notes)


def evaluate(structure: Structure, excitation: Excitation, periods: int = PERIODS) -> Evaluation:
    """Return what one averaged period tells about the parameters: the covariance (F' S^-1 F)^-1.

    S: the noise variance over the number of periods.

    Rows are the samples of one period, in SI units, with the exact sign function.
    """
    columns = structure.columns(excitation.samples())
    variances = noise_variances(structure.robot)[0] / periods
    return evaluate_rows((columns / np.sqrt(variances)[:, None]).reshape(-1, columns.shape[-1]))


def evaluate_rows(rows: Array) -> Evaluation:
    """Return what weighted rows S^-1/2 F [R, p] tell."""
    columns, one = rows[:, None, :], np.ones(1)
    return Evaluation(
        log10_det_covariance(columns, one), condition_number(columns, one), standard_deviations(columns, one)
    )
