"""A payload on an arm that is known: its mass, centre and inertia from a short motion.

tau = Y theta + Y_last pi + friction: the arm's parameters theta keep what its model says, by their covariance; the ten
of the payload are free, and friction, which differs from day to day and with the load, is found anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.covariance import sandwich
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.problem import Problem
from robot_ident.model.model import Model
from robot_ident.motion import Array
from robot_ident.recording.conditions import Conditions, KnownPayload, hand, payload_columns
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.rigid_body import STANDARD

_SURE = 1.96  # standard deviations of a 95 % interval
_VAGUE = (200.0, 200.0, 200.0, 200.0, *(200.0,) * 6)  # kg, kg m, kg m^2: more than any payload, before data
_TOLD = 0.25  # share of that which data must bring the standard deviation below
_LOUD = 1.4  # times the noise
_CLEARLY = 4.0  # standard deviations
_DIGITS = 1e-12  # share of the largest eigenvalue below which a covariance holds rounding


@dataclass(frozen=True)
class PayloadFit:
    """A payload: ten parameters [10] about and along the last joint's frame with covariance [10, 10], and what follows.

    centre [3] m in the end effector's frame; inertia (3 x 3) kg m^2 about the centre along its axes; their standard
    deviations by the first order. told [10]: whether the data say anything of a parameter. stated: what the
    recordings' conditions say of it, None where nothing. residual_rms by joint, noise_rms None where not known.
    """

    values: Array
    covariance: Array
    told: tuple[bool, ...]
    centre: Array
    centre_std: Array
    inertia: Array
    inertia_std: Array
    residual_rms: dict[str, float]
    noise_rms: dict[str, float | None]
    stated: KnownPayload | None
    notes: tuple[str, ...]

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.values[0])

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance[0, 0]))

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --only payload --json` prints."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            "schema": "robot_ident/payload/1",
            "mass": self.mass,
            "mass_std": self.mass_std,
            "mass_interval": [self.mass - _SURE * self.mass_std, self.mass + _SURE * self.mass_std],
            "centre": self.centre.tolist(),
            "centre_std": self.centre_std.tolist(),
            "centre_interval": [
                [float(c - _SURE * s), float(c + _SURE * s)] for c, s in zip(self.centre, self.centre_std, strict=True)
            ],
            "inertia": [float(self.inertia[i, j]) for i, j in _ENTRIES],
            "inertia_std": [float(self.inertia_std[i, j]) for i, j in _ENTRIES],
            "parameters": [
                {"name": name, "value": float(value), "std": float(s), "told": told}
                for name, value, s, told in zip(STANDARD, self.values, std, self.told, strict=True)
            ],
            "residual_rms": self.residual_rms,
            "noise_rms": self.noise_rms,
            "stated_mass": None if self.stated is None else self.stated.mass,
            "notes": list(self.notes),
        }


_ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def bare(conditions: Conditions) -> Conditions:
    """Return the conditions of a recording whose payload is to be found, whatever they state of it."""
    from dataclasses import replace

    return replace(conditions, payload=None, estimated=False)


def identify_payload(
    measurements: Sequence[Measurement], model: Model, stated: KnownPayload | None = None
) -> PayloadFit:
    """Return the payload that recordings of a known arm carried, `measurements` with it still in the torque.

    Raises InputError where the arm's parameters carry the unit A, or the hand is not on the last link.
    """
    robot, structure = model.robot, model.structure
    if robot.ampere_joints:
        raise InputError(f"robot {robot.name}: without drive gains ({', '.join(robot.ampere_joints)}) no mass is known")
    rotation, origin = hand(robot)
    problem = Problem(measurements, structure)
    linear = model.linear
    equations = problem.equations(structure, linear)
    columns = np.vstack([_rows(measurements, equations, block, robot) for block in range(len(measurements))])
    free = _free(model)
    held = [k for k in range(len(linear)) if k not in free]
    jacobian = np.hstack([equations.phi, columns])
    right = equations.torque - equations.phi @ linear
    root = _inverse_root(model.covariance[np.ix_(held, held)])
    solved, covariance = _solve(problem, equations, jacobian, right, held, root)
    p = len(linear)
    values, own = solved[p:], covariance[p:, p:]
    told = tuple(bool(s < _TOLD * v) for s, v in zip(np.sqrt(np.diag(own)), _VAGUE, strict=True))
    if not all(told[:4]):
        raise InputError(
            f"{problem.source}: the motion does not tell mass and centre of a payload; design one:"
            " robot_ident design --only payload --model MODEL -o payload.yaml"
        )
    residual = right - jacobian @ solved
    rms = _rms(residual, equations, robot.joints)
    noise = {
        joint: _finite(np.sqrt(np.mean(equations.variance[equations.joint == k])))
        for k, joint in enumerate(robot.joints)
    }
    centre, inertia, spread = _body(values, own, rotation, origin)
    return PayloadFit(
        values=values,
        covariance=own,
        told=told,
        centre=centre,
        centre_std=spread[:3],
        inertia=inertia,
        inertia_std=_symmetric(spread[3:]),
        residual_rms=rms,
        noise_rms=noise,
        stated=stated,
        notes=(*_notes(values, inertia, float(spread[3:].max()), told), *_loud(rms, noise)),
    )


def _rows(measurements: Sequence[Measurement], equations: Equations, block: int, robot: Any) -> Array:
    """Return the payload's columns [r, 10] at one measurement's rows, in the order of the equations."""
    measured = measurements[block]
    whole = measured.passed(payload_columns(robot, measured.motion))
    rows = equations.block == block
    out: Array = whole[equations.sample[rows], equations.joint[rows]]
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


def _solve(
    problem: Problem, equations: Equations, jacobian: Array, right: Array, held: Sequence[int], root: Array
) -> tuple[Array, Array]:
    """Return all parameters' changes [p + 10] and their covariance: data, what the model knows, and a vague payload."""
    noise = problem.noise
    weight = np.sqrt(noise.independent)
    white = noise.whiten(jacobian) * weight[:, None]
    total = jacobian.shape[1]
    known = np.zeros((len(held), total))
    known[:, list(held)] = root
    vague = np.zeros((10, total))
    vague[:, -10:] = np.diag(1.0 / np.array(_VAGUE))
    stacked = np.vstack([white, known, vague])
    scale = np.linalg.norm(stacked, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    target = np.concatenate([noise.whiten(right) * weight, np.zeros(len(held) + 10)])
    solved, *_ = np.linalg.lstsq(stacked / scale, target, rcond=None)
    solved = solved / scale
    bread = np.linalg.pinv((stacked / scale).T @ (stacked / scale), rcond=1e-15) / np.outer(scale, scale)
    if not problem.unknown and noise.weighs:
        return solved, np.asarray(bread)
    residual = right - jacobian @ solved
    prior = known.T @ known + vague.T @ vague
    data = sandwich(bread, noise.precision(jacobian), residual, equations, noise, problem.unknown)
    return solved, np.asarray(data + bread @ prior @ bread)


def _body(values: Array, covariance: Array, rotation: Array, origin: Array) -> tuple[Array, Array, Array]:
    """Return centre [3], inertia [3, 3] about it, both in the hand's frame, and standard deviations [9]."""

    def derived(x: Array) -> Array:
        mass, first = x[0], x[1:4]
        xx, xy, yy, xz, yz, zz = x[4:]
        p = first / mass
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - mass * (p @ p * np.eye(3) - np.outer(p, p))
        turned = rotation.T @ about @ rotation
        return np.concatenate([rotation.T @ (p - origin), [turned[i, j] for i, j in _ENTRIES]])

    slope = np.empty((9, 10))
    sigma = np.sqrt(np.diag(covariance))
    for k in range(10):
        step = np.zeros(10)
        step[k] = 1e-4 * max(float(sigma[k]), 1e-9)
        slope[:, k] = (derived(values + step) - derived(values - step)) / (2.0 * step[k])
    found = derived(values)
    spread = np.sqrt(np.maximum(np.diag(slope @ covariance @ slope.T), 0.0))
    return found[:3], _symmetric(found[3:]), spread


def _symmetric(six: Array) -> Array:
    xx, xy, yy, xz, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _rms(residual: Array, equations: Equations, joints: Sequence[str]) -> dict[str, float]:
    return {joint: float(np.sqrt(np.mean(residual[equations.joint == k] ** 2))) for k, joint in enumerate(joints)}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _notes(values: Array, inertia: Array, spread: float, told: Sequence[bool]) -> tuple[str, ...]:
    notes = []
    if values[0] <= 0:
        notes.append("its mass is not positive: does the model hold this payload already?")
    unknown = [name for name, known in zip(STANDARD, told, strict=True) if not known]
    if unknown:
        notes.append(f"the motion does not tell {', '.join(unknown)}")
    elif np.linalg.eigvalsh(inertia)[0] < -_CLEARLY * spread:
        notes.append("its inertia about the centre is that of no body: the arm's model may not be this arm's today")
    return tuple(notes)


def _loud(rms: Mapping[str, float], noise: Mapping[str, float | None]) -> list[str]:
    """Return a line that names the joints whose residual is far above the noise."""
    loud = [joint for joint, level in noise.items() if level is not None and rms[joint] > _LOUD * level]
    if not loud:
        return []
    return [
        f"the residual at {', '.join(loud)} is more than {_LOUD:g} times the noise: intervals hold for noise alone, and"
        " what the model lacks there (or a hand that swings) goes into the payload"
    ]
