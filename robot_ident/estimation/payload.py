"""A payload on an arm that is known: its mass, centre and inertia from a short motion.

tau = Y theta + Y_last pi + friction: the arm's parameters theta keep what its model says, by their covariance; the ten
of the payload are free, and friction, which differs from day to day and with the load, is found anew.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.body import Body, body_of
from robot_ident.estimation.covariance import sandwich
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.held_body import Holding
from robot_ident.estimation.problem import Problem
from robot_ident.model.model import Model
from robot_ident.recording.conditions import Conditions, KnownPayload, PayloadPart, hand, payload_columns
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_ROUNDS = 8
_STILL = 0.02  # standard deviations that a parameter may yet move by
_LOUD = 1.4  # times the noise
_DIGITS = 1e-12  # share of the largest eigen- or singular value below which there is rounding alone


@dataclass(frozen=True)
class PayloadFit:
    """A payload, and how well a model of the arm with it follows the recordings.

    stated: what the recordings' conditions say of it, None where nothing. residual_rms by joint, noise_rms None where
    not known.
    """

    body: Body
    residual_rms: Mapping[str, float]
    noise_rms: Mapping[str, float | None]
    stated: KnownPayload | None
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --only payload --json` prints."""
        return {
            "schema": "robot_ident/payload/1",
            **self.body.to_dict(),
            "residual_rms": dict(self.residual_rms),
            "noise_rms": dict(self.noise_rms),
            "stated_mass": None if self.stated is None else self.stated.mass,
            "notes": list(self.notes),
        }


def bare(conditions: Conditions) -> Conditions:
    """Return the conditions of a recording whose payload is to be found, whatever they state of it."""
    from dataclasses import replace

    return replace(conditions, payload=None, estimated=False)


def identify_payload(
    measurements: Sequence[Measurement],
    model: Model,
    stated: KnownPayload | None = None,
    part: PayloadPart = PayloadPart(),  # noqa: B008 - frozen
) -> PayloadFit:
    """Return the payload that recordings of a known arm carried, `measurements` with it still in the torque.

    part: what is known of it and held.

    Raises InputError where the arm's parameters carry the unit A, or the hand is not on the last link.
    """
    robot, structure = model.robot, model.structure
    if robot.ampere_joints:
        raise InputError(f"robot {robot.name}: without drive gains ({', '.join(robot.ampere_joints)}) no mass is known")
    hand(robot)
    problem = Problem(measurements, structure)
    linear = model.linear
    equations = problem.equations(structure, linear)
    columns = rows_of_payload(measurements, equations, robot, range(len(measurements)))
    free = _free(model)
    held = [k for k in range(len(linear)) if k not in free]
    root = _inverse_root(model.covariance[np.ix_(held, held)])
    p, holding = len(linear), Holding(part, robot)
    values = holding.start()
    for _ in range(_ROUNDS if holding.curved else 1):
        directions, vague = holding.directions(values)
        jacobian = np.hstack([equations.phi, columns @ directions])
        right = equations.torque - equations.phi @ linear - columns @ values
        solved, spread = solve_beside(problem, equations, jacobian, right, (held, root), vague)
        change, covariance = directions @ solved[p:], directions @ spread[p:, p:] @ directions.T
        values = holding.settled(values + change)
        if np.all(np.abs(change) <= _STILL * np.sqrt(np.diag(covariance))):
            break
    found = body_of(values, covariance, robot, holding.given)
    if not all(found.told[:4]):
        raise InputError(
            f"{problem.source}: the motion does not tell mass and centre of a payload; design one:"
            " robot_ident design --only payload --model MODEL -o payload.yaml"
        )
    residual = right - jacobian @ solved
    noise = {
        joint: _finite(np.sqrt(np.mean(equations.variance[equations.joint == k])))
        for k, joint in enumerate(robot.joints)
    }
    rms = _rms(residual, equations, robot.joints)
    return PayloadFit(found, rms, noise, stated, (*found.notes, *_loud(rms, noise)))


def rows_of_payload(
    measurements: Sequence[Measurement], equations: Equations, robot: Robot, blocks: Iterable[int]
) -> Array:
    """Return the ten columns [R, 10] of a payload that some of the measurements carried, zero in rows of the others."""
    out = np.zeros((equations.rows, 10))
    for block in blocks:
        whole = measurements[block].passed(payload_columns(robot, measurements[block].motion))
        rows = equations.block == block
        out[rows] = whole[equations.sample[rows], equations.joint[rows]]
    return out


def _free(model: Model) -> list[int]:
    """Return the linear parameters that are found anew: friction's."""
    loose = {e.name for e in model.structure.effects if e.symmetry in ("dissipative", "memory", "mixed")}
    return [k for k, parameter in enumerate(model.structure.parameters) if parameter.effect in loose]


def _inverse_root(covariance: Array) -> Array:
    """Return R [p, p] with R' R = C^-1; directions without any spread are held firmly."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    values = np.maximum(values, _DIGITS * max(float(values[-1]), _DIGITS))
    return np.asarray((vectors / np.sqrt(values)).T / scale)


def solve_beside(
    problem: Problem,
    equations: Equations,
    jacobian: Array,
    right: Array,
    known: tuple[Sequence[int], Array],
    vague: Array,
) -> tuple[Array, Array]:
    """Return all changes [p + m] and their covariance: data, what is known of some, and m of payloads at last, of
    standard deviations `vague` [m] before data.

    jacobian [R, p + m]: derivatives of torque; right [R] Nm. known: places [k] among the first p, and the root [k, k]
    of their information before data.
    """
    noise = problem.noise
    weight = np.sqrt(noise.independent)
    white = noise.whiten(jacobian) * weight[:, None]
    total = jacobian.shape[1]
    held, root = known
    before = np.zeros((len(held) + len(vague), total))
    before[: len(held), list(held)] = root
    before[len(held) :, total - len(vague) :] = np.diag(1.0 / vague)
    stacked = np.vstack([white, before])
    scale = np.linalg.norm(stacked, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    target = np.concatenate([noise.whiten(right) * weight, np.zeros(len(before))])
    q, triangle = np.linalg.qr(stacked / scale)
    left, size, turn = np.linalg.svd(triangle)
    kept = size > _DIGITS * size[0]
    inverse = turn[kept].T / size[kept]
    solved = inverse @ (left[:, kept].T @ (q.T @ target)) / scale
    bread = inverse @ inverse.T / np.outer(scale, scale)
    if not problem.unknown and noise.weighs:
        return solved, np.asarray(bread)
    residual = right - jacobian @ solved
    prior = before.T @ before
    data = sandwich(bread, noise.precision(jacobian), residual, equations, noise, problem.unknown)
    return solved, np.asarray(data + bread @ prior @ bread)


def _rms(residual: Array, equations: Equations, joints: Sequence[str]) -> dict[str, float]:
    return {joint: float(np.sqrt(np.mean(residual[equations.joint == k] ** 2))) for k, joint in enumerate(joints)}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _loud(rms: Mapping[str, float], noise: Mapping[str, float | None]) -> list[str]:
    """Return a line that names the joints whose residual is far above the noise."""
    loud = [joint for joint, level in noise.items() if level is not None and rms[joint] > _LOUD * level]
    if not loud:
        return []
    return [
        f"the residual at {', '.join(loud)} is more than {_LOUD:g} times the noise: intervals hold for noise alone, and"
        " what the model lacks there (or a hand that swings) goes into the payload"
    ]
