"""Does the coupling that a robot YAML declares fit the data? Each drive's torque against the URDF's at all joints.

tau = C u: the drives' torques are u = D tau, D = C^-1. Every row of D comes from a fit of that drive's torque to the
torques of all joints by the URDF's masses, friction set apart. A row that points elsewhere than the declared one is a
wrong coupling; a row along it, longer or turned round, is a drive's gain or sign.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robot_ident.estimation.contradiction import Contradiction
from robot_ident.estimation.declaration import clustered
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_ALONG = 0.9  # cosine of the angle between found and declared row from which on they are the same
_TOLD = 0.1  # sigma of an entry over the row's length up to which it is told
_SHAPE = 0.7  # part of a drive's torque, friction left aside, that the URDF's must account for
_BLOCK = 0.5  # s; within it residuals are not independent


def coupling_contradiction(measurements: Sequence[Measurement], robot: Robot) -> Contradiction | None:
    """Return that the declared coupling contradicts the data and the matrix that fits; None where nothing tells so.

    Judged on the recording that tells the rows best, where all of them are told.
    """
    declared = robot.effort.coupling
    if declared is None:
        return None
    expected = np.linalg.inv(declared)
    told = [rows for measured in measurements if (rows := _rows(measured, robot, declared)) is not None]
    if not told:
        return None
    found, _, explained = min(told, key=lambda one: float(one[1].max()))
    cosine = np.sum(found * expected, axis=1) / np.linalg.norm(found, axis=1) / np.linalg.norm(expected, axis=1)
    wrong = (np.abs(cosine) < _ALONG) & (explained > _SHAPE)
    if not wrong.any() or np.linalg.matrix_rank(found) < robot.n:
        return None
    fit = np.linalg.inv(np.where(wrong[:, None], found, expected))
    joints = [robot.joints[k] for k in np.flatnonzero(wrong)]
    share = {joint: float(abs(cosine[robot.joint_index(joint)])) for joint in joints}
    change = f"effort: {{coupling: {_text(fit)}}}"
    return Contradiction(
        "effort.coupling", _text(declared), change, share, "how far its drives' rows agree, 1 = wholly"
    )


def _rows(measured: Measurement, robot: Robot, coupling: Array) -> tuple[Array, Array, Array] | None:
    """Return D [n, n], the standard deviations of its entries over the rows' length, and the part [n] of each drive's
    torque beside friction that it accounts for; None where it isn't told.
    """
    rigid = robot.rigid.inverse_dynamics(measured.motion)
    v = measured.motion.dq
    columns = measured.passed(np.hstack([rigid, v, np.sign(v), np.ones((len(v), 1))]))
    used = measured.used[measured.rows].all(axis=1)
    torque = np.linalg.solve(coupling, measured.passed(measured.torque).T).T[used]
    columns, n = columns[used], robot.n
    scale = np.linalg.norm(columns, axis=0)
    if len(columns) < 10 * columns.shape[1] or not np.all(scale > 0):
        return None
    scaled = columns / scale
    values, *_ = np.linalg.lstsq(scaled, torque, rcond=1e-9)
    residual = torque - scaled @ values
    plain, *_ = np.linalg.lstsq(scaled[:, n:], torque, rcond=1e-9)
    without = np.sum((torque - scaled[:, n:] @ plain) ** 2, axis=0)
    explained = 1.0 - np.sum(residual**2, axis=0) / np.maximum(without, 1e-300)
    block = max(1, round(_BLOCK / (measured.dt * measured.decimate)))
    spread = np.column_stack([np.sqrt(np.maximum(np.diag(clustered(scaled, rest, block)), 0.0)) for rest in residual.T])
    found, std = (np.asarray((part / scale[:, None])[:n].T) for part in (values, spread))
    relative = std / np.linalg.norm(found, axis=1)[:, None]
    return (found, relative, explained) if np.all(relative < _TOLD) else None


def _text(matrix: Array) -> str:
    """Return a matrix as YAML, to two digits."""
    rows = ("[" + ", ".join(f"{round(float(x), 2) + 0.0:g}" for x in row) + "]" for row in matrix)
    return f"[{', '.join(rows)}]"
