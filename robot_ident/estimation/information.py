"""What recordings tell about the parameters of a model: the information that a further motion adds to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.maximum_likelihood import Trajectory
from robot_ident.estimation.problem import Problem
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array


def information(
    measurements: Sequence[Measurement], structure: Structure, values: Array | None = None, *, bound: bool = False
) -> Array:
    """Return F' S^-1 F [p, p] of measurements, S the noise that they show (Swevers et al. 1997, eq. 9).

    values [p]: where columns depend on the model's torque. bound: with noise on positions too, the Schur complement
    F_tt - F_td F_dd^-1 F_dt (eq. 6), which needs values. Inner parameters count as known. Raises InputError where the
    bound is asked for and a measurement isn't periodic.
    """
    problem = Problem(measurements, structure)
    equations, noise = problem.equations(structure, values), problem.noise
    root = np.sqrt(noise.independent)
    rows = noise.whiten(equations.phi) * root[:, None]
    out = rows.T @ rows
    if not bound:
        return np.asarray(out)
    if values is None:
        raise ValueError("the bound needs an estimate")
    for block, measured in enumerate(measurements):
        if measured.position_lines is None:
            raise InputError(
                f"{measured.source}: not periodic, so its position noise is unknown and the Cramer-Rao bound too;"
                " use another criterion"
            )
        trajectory = Trajectory.of(measured, structure, values)
        slope, _ = trajectory.torque_slope(structure, measured.motion, values)
        mine = equations.block == block
        whole = np.zeros((len(mine), slope.shape[2]))
        whole[mine] = measured.passed(slope)[equations.sample[mine], equations.joint[mine]]
        moved = (noise.whiten(whole) * root[:, None])[mine]
        cross = moved.T @ rows[mine]
        out = out - cross.T @ np.linalg.solve(moved.T @ moved + np.diag(1.0 / trajectory.variance), cross)
    return np.asarray(out)
