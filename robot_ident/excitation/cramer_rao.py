"""What a motion tells when positions are noisy too: the Cramer-Rao bound (Swevers et al. 1997, eq. 6, with J' W J).

The coefficients delta of the motion's Fourier lines are estimated beside theta, as maximum likelihood does. The noise
of the positions is white, so their samples tell each line independently, with the variance 2 s^2 / N of an amplitude
(s^2 / N of the mean). What is left for theta is the Schur complement F_tt - F_td F_dd^-1 F_dt.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.signals.motion import Array


def line_bases(orders: Sequence[int], base_frequency: float, t: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration [N, 1 + 2 L] at instants t per unit of mean, cosine and sine
    amplitudes of L lines.
    """
    w = 2.0 * np.pi * base_frequency * np.asarray(orders, dtype=float)
    c, s = np.cos(np.outer(t, w)), np.sin(np.outer(t, w))
    one, zero = np.ones((len(t), 1)), np.zeros((len(t), 1))
    return (
        np.hstack([one, c, s]),
        np.hstack([zero, -w * s, w * c]),
        np.hstack([zero, -w * w * c, -w * w * s]),
    )


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
    columns = []
    for joint in range(n):
        columns.append(sum(ca.mtimes(part[:, joint], wave.T) for part, wave in zip(parts, waves, strict=True)))
    one = ca.mtimes(ca.horzcat(*columns), ca.diag(ca.DM(deviations)))
    rows = ca.Function("lines", [*symbols, *waves], [ca.densify(one)]).map(points)
    found = rows(*states[: slopes.n_in()], *(ca.DM(base.T) for base in bases))
    return ca.vertcat(*ca.horzsplit(found, n * width))
