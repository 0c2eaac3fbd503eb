"""How much a motion tells about the parameters: determinant and condition number as the paper defines them.

Where positions are noisy too, by the Cramer-Rao bound (Swevers et al. 1997, eq. 6, with J' W J): the coefficients delta
of the motion's Fourier lines are estimated beside theta, as maximum likelihood does. The noise of the positions is
white, so their samples tell each line independently, with the variance 2 s^2 / N of an amplitude (s^2 / N of the mean).
What is left for theta is the Schur complement F_tt - F_td F_dd^-1 F_dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.model.structure import Structure
    from robot_ident.trajectories.excitation import Excitation


PERIODS = 16  # periods that the paper averages
_OPEN = 1e-6  # of a direction that no torque tells: a part of it that is no rounding
ASSUMED_NOISE = 0.01  # of the torque limit, where a robot gives no noise variance


class Evaluation(NamedTuple):
    """What a motion tells: log10 of the determinant of the covariance, condition number, standard deviations [p]."""

    log10_det_covariance: float
    condition_number: float
    sigma: Array


def _normalised(rows: Array) -> tuple[Array, Array]:
    """Return rows [R, p] with columns of length one, and their lengths [p]."""
    length = np.linalg.norm(rows, axis=0)
    return rows / np.where(length > 0, length, 1.0), length


def _rounding(values: Any, rows: Array) -> float:
    """Return below what a singular value of rows [R, p] is rounding."""
    return float(values[0] * max(rows.shape) * np.finfo(float).eps)


def evaluate_rows(rows: Array) -> Evaluation:
    """Return what weighted rows S^-1/2 F [R, p] tell; all are inf where parameters can't be told apart.

    log10 det (F' S^-1 F)^-1 (Swevers et al. 1997, eq. 9), s_max / s_min of the rows with columns divided by their
    length, and the standard deviations sqrt diag (F' S^-1 F)^-1.
    """
    normalised, length = _normalised(rows)
    values = np.linalg.svd(normalised, compute_uv=False)
    if len(values) < len(length) or not (values[-1] > _rounding(values, normalised) and np.all(length > 0)):
        return Evaluation(float("inf"), float("inf"), np.full(len(length), np.inf))
    _, sizes, vt = np.linalg.svd(normalised, full_matrices=False)
    return Evaluation(
        log10_det_covariance=float(-2.0 * (np.log10(values).sum() + np.log10(length).sum())),
        condition_number=float(values[0] / values[-1]),
        sigma=np.asarray(np.linalg.norm(vt / sizes[:, None], axis=0) / length),
    )


def unidentifiable(rows: Array) -> Array:
    """Return which parameters [p] weighted rows F [R, p] leave open: those that some direction v with F v = 0 moves."""
    normalised, length = _normalised(rows)
    _, values, vt = np.linalg.svd(np.linalg.qr(normalised, mode="r"), full_matrices=True)
    rank = int(np.count_nonzero(values > _rounding(values, normalised)))
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
    """Return what one period, the mean of `periods`, tells about the parameters: the covariance (F' S^-1 F)^-1.

    S: the noise variance over the number of periods. F: the samples of one period, with the exact sign function.
    """
    columns = structure.columns(excitation.samples())
    variances = noise_variances(structure.robot)[0] / periods
    return evaluate_rows((columns / np.sqrt(variances)[:, None]).reshape(-1, columns.shape[-1]))


def line_bases(orders: Sequence[int], base_frequency: float, t: Array) -> tuple[Array, Array, Array]:
    """Return q, dq, ddq [N, 1 + 2 L] at instants t [N] per unit of mean, cosine and sine amplitudes of L lines."""
    w = 2.0 * np.pi * base_frequency * np.asarray(orders, dtype=float)
    c, s = np.cos(np.outer(t, w)), np.sin(np.outer(t, w))
    one, zero = np.ones((len(t), 1)), np.zeros((len(t), 1))
    speed, acceleration = np.hstack([zero, -w * s, w * c]), np.hstack([zero, -w * w * c, -w * w * s])
    return np.hstack([one, c, s]), speed, acceleration


def line_deviations(orders: Sequence[int], variances: Array, samples: int) -> Array:
    """Return the standard deviations [n (1 + 2 L)] of the lines' amplitudes, joint by joint, as positions tell them.

    variances [n] rad^2 of the noise of one of the `samples` (averaged) positions a period.
    """
    share = np.concatenate([[1.0], np.full(2 * len(orders), 2.0)]) / samples
    return np.asarray(np.sqrt(np.outer(variances, share)).ravel())


def bound_information(phi: Array, slopes: Array, bases: tuple[Array, Array, Array], deviations: Array) -> Array:
    """Return the information [p, p] about theta, F_tt - F_td F_dd^-1 F_dt.

    phi [N, n, p] and slopes [N, n, 3 n] (torque by q, dq, ddq) are divided by the standard deviation of each joint's
    torque already; deviations [n (1 + 2 L)] are those of the lines.
    """
    rows, n, p = phi.shape
    parts = slopes.reshape(rows, n, 3, n)
    lines = sum(parts[:, :, k, :, None] * base[:, None, None, :] for k, base in enumerate(bases))
    moved = np.asarray(lines).reshape(rows * n, -1) * deviations
    columns = phi.reshape(rows * n, p)
    cross = moved.T @ columns
    inner = moved.T @ moved + np.eye(moved.shape[1])
    return np.asarray(columns.T @ columns - cross.T @ np.linalg.solve(inner, cross))


def line_rows(
    slopes: Any, states: Sequence[Any], bases: tuple[Array, Array, Array], size: Array, deviations: Array
) -> Any:
    """Return the torque's derivatives by the lines' amplitudes [n N, n (1 + 2 L)] along N states, in their deviations.

    slopes: CasADi function of a state -> [n, 3 n]; size [n]: weight of each joint's torque.
    """
    n, points = states[0].shape
    width = bases[0].shape[1]
    symbols = [ca.SX.sym("x", n) for _ in range(slopes.n_in())]
    waves = [ca.SX.sym("b", width) for _ in bases]
    parts = ca.horzsplit(ca.mtimes(ca.diag(ca.DM(size)), slopes(*symbols)), n)
    columns = [
        sum(ca.mtimes(part[:, joint], wave.T) for part, wave in zip(parts, waves, strict=True)) for joint in range(n)
    ]
    one = ca.mtimes(ca.horzcat(*columns), ca.diag(ca.DM(deviations)))
    rows = ca.Function("lines", [*symbols, *waves], [ca.densify(one)]).map(points)
    found = rows(*states[: slopes.n_in()], *(ca.DM(base.T) for base in bases))
    return ca.vertcat(*ca.horzsplit(found, n * width))
