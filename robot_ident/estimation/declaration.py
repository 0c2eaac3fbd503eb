"""Does the effort mean what the robot YAML declares? Held against the rigid model of the URDF."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.motion import Array, Motion
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot

_NEAR = 0.35  # a URDF's masses are seldom better than that
_LITTLE = 0.15  # share below which next to nothing of it is found
_SURE = 4.0  # standard deviations
_BLOCK = 0.5  # s; within it the residual is not independent
_HARDLY = 0.1  # sigma of the share from which on the motion loads a joint well enough to tell


@dataclass(frozen=True)
class Declared:
    """What a recording says of a joint's effort: `share` of the URDF's gravity torque (of the inertial one where the
    joint carries no gravity) that is found in it, with its standard deviation, the verdict, and what to look at.

    verdict: consistent, compensated (gravity is taken out), sign, factor, or not_told where the motion loads the joint
    too little.
    """

    joint: str
    share: float
    std: float
    verdict: str
    hint: str


def judge_declaration(recording: Recording, robot: Robot) -> list[Declared]:
    """Return by joint how effort and rigid model go together.

    tau = k_g g(q) + k_i (tau_rigid - g(q)) + b dq + c sign(dq) + offset: k_g near 1 is consistent; near 0 beside k_i
    near 1 the driver has taken gravity out; below 0 the sign is wrong; any other constant is a gain, a gear ratio or a
    current in ampere. Needs masses in the URDF. Raises InputError where the recording isn't of this robot.
    """
    measured = process(recording, robot, Processing(periodic=False))
    motion = measured.motion
    still = np.zeros_like(motion.q)
    gravity = robot.rigid.inverse_dynamics(Motion(motion.q, still, still))
    inertial = robot.rigid.inverse_dynamics(motion) - gravity
    return [_judge(robot, measured, gravity[:, joint], inertial[:, joint], joint) for joint in range(robot.n)]


def _judge(robot: Robot, measured: Measurement, gravity: Array, inertial: Array, joint: int) -> Declared:
    v = measured.motion.dq[:, joint]
    columns = measured.passed(np.column_stack([gravity, inertial, v, np.sign(v), np.ones(len(v))]))
    rows = measured.used[measured.rows, joint]
    columns, tau = columns[rows], measured.passed(measured.torque)[rows, joint]
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-9 * size.max(initial=1.0), size, np.inf)  # a column of nothing tells nothing
    if len(columns) < 10:
        return Declared(robot.joints[joint], float("nan"), float("inf"), "not_told", "it hardly moves")
    scaled = columns / size
    solved, *_ = np.linalg.lstsq(scaled, tau, rcond=1e-9)
    spread = _clustered(scaled, tau - scaled @ solved, max(1, round(_BLOCK / measured.dt)))
    told = [(float(solved[k] / size[k]), float(spread[k] / size[k])) for k in (0, 1) if np.isfinite(size[k])]
    told = [(share, std) for share, std in told if 0.0 < std < _HARDLY or abs(share) > _SURE * std > 0.0]
    if not told:
        return Declared(robot.joints[joint], float("nan"), float("inf"), "not_told", "the motion loads it too little")
    return _verdict(robot, joint, told)


def _verdict(robot: Robot, joint: int, told: list[tuple[float, float]]) -> Declared:
    """Return the verdict on the shares (value, sigma) that are told: of gravity, then of inertia."""
    (share, std), (inertia, _) = told[0], told[-1]
    name, unit = robot.joints[joint], robot.torque_unit(joint)
    if abs(share - 1.0) < max(_NEAR, _SURE * std):
        return Declared(name, share, std, "consistent", "")
    if share < -max(_LITTLE, _SURE * std):
        return Declared(name, share, std, "sign", "it grows where the rigid torque falls: opposite sign")
    if len(told) > 1 and abs(share) < max(_LITTLE, _SURE * std) and inertia > 1.0 - _NEAR:
        return Declared(name, share, std, "compensated", "gravity is not in it: does the driver take it out?")
    asked = "torque_constant, or effort: torque" if robot.effort == "current" else "effort: current, or torque_constant"
    hint = f"{share:.3g} times the URDF's {unit}: a gain, a gear ratio or ampere ({asked})?"
    return Declared(name, share, std, "factor", hint)


def _clustered(columns: Array, residual: Array, block: int) -> Array:
    """Return standard deviations [k] that hold when errors within a block depend on each other."""
    inverse = np.linalg.pinv(columns.T @ columns)
    pieces = np.array_split(columns * residual[:, None], max(2, len(residual) // block))
    scores = np.array([piece.sum(axis=0) for piece in pieces])
    return np.sqrt(np.maximum(np.diag(inverse @ scores.T @ scores @ inverse), 0.0))
