"""Identification: from recordings to a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.estimation.equations import Equations, stack
from robot_ident.estimation.least_squares import factor, ordinary, weighted
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot

Estimator = Callable[[Array, Array, Array, Sequence[str], str], tuple[Array, Array]]

ESTIMATORS: dict[str, Estimator] = {"ls": ordinary, "wls": weighted}


def identify(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    effects: Sequence[str] = (),
    estimator: str = "wls",
    processing: Processing | None = None,
) -> Model:
    """Estimate a robot's parameters from one or several recordings.

    Raises InputError on recordings that can't be used, unknown effects or estimators, and motions that don't excite a
    parameter.
    """
    processing = processing or Processing()
    structure = Structure.build(robot, effects)
    measurements = [process(recording, robot, processing) for recording in recordings]
    return estimate(measurements, structure, estimator=estimator, processing=processing)


def estimate(
    measurements: Sequence[Measurement],
    structure: Structure,
    *,
    estimator: str = "wls",
    processing: Processing | None = None,
) -> Model:
    """Return the model of some measurements: eq. (7) or (10) with its covariance."""
    if estimator not in ESTIMATORS:
        raise InputError(f"unknown estimator {estimator!r}{did_you_mean(estimator, ESTIMATORS)}")
    if not measurements:
        raise InputError("no recording was given")
    source = ", ".join(measured.source for measured in measurements)
    equations = stack(measurements, structure)
    variance, notes = _variances(equations, structure, measurements, source)
    # a low pass leaves fewer independent rows: the information of R rows is that of R * share
    values, covariance = ESTIMATORS[estimator](
        equations.phi, equations.torque, variance / equations.independent, structure.names, source
    )
    _, logdet = np.linalg.slogdet(covariance)
    return Model(
        structure=structure,
        values=values,
        covariance=covariance,
        estimator=estimator,
        noise=_noise(measurements),
        residual=_fits(equations, equations.torque - equations.phi @ values, structure),
        condition_number=factor(equations.phi, 1.0 / variance, structure.names, source).condition_number,
        log10_det_covariance=float(logdet / np.log(10.0)),
        processing=asdict(processing or Processing()),
        notes=(*structure.notes, *(f"{m.source}: {note}" for m in measurements for note in m.notes), *notes),
    )


def _variances(
    equations: Equations, structure: Structure, measurements: Sequence[Measurement], source: str
) -> tuple[Array, tuple[str, ...]]:
    """Return the noise variance of every row; from the residual of ordinary least squares where no periods tell it."""
    unknown = ~np.isfinite(equations.variance) | (equations.variance <= 0)
    if not unknown.any():
        return equations.variance, ()
    ones = np.ones(equations.rows)
    theta, _ = ordinary(equations.phi, equations.torque, ones, structure.names, source)
    residual = equations.torque - equations.phi @ theta
    variance = equations.variance.copy()
    share = equations.rows / (equations.rows - len(structure.parameters))
    for block in range(len(measurements)):
        for joint in range(structure.robot.n):
            rows = (equations.block == block) & (equations.joint == joint) & unknown
            if rows.any():
                variance[rows] = max(float(np.mean(residual[rows] ** 2)) * share, 1e-12)
    return variance, ("noise unknown without periods: rows weighted by the residual of ordinary least squares",)


def _noise(measurements: Sequence[Measurement]) -> NoiseLevel:
    """Return the noise of one sample, pooled over recordings by their degrees of freedom."""
    weights = np.array([measured.variance_dof for measured in measurements])
    periodic = [measured for measured, dof in zip(measurements, weights, strict=True) if dof > 0]
    first = periodic[0] if periodic else measurements[0]

    def pooled(variances: list[Array]) -> tuple[float | None, ...]:
        if not periodic:
            return (None,) * len(measurements[0].joints)
        mean = np.average(np.array(variances), axis=0, weights=weights[weights > 0])
        return tuple(float(value) for value in mean)

    return NoiseLevel(
        pooled([measured.torque_variance for measured in periodic]),
        pooled([measured.position_variance for measured in periodic]),
        first.periods,
        first.samples_per_period,
    )


def _fits(equations: Equations, residual: Array, structure: Structure) -> dict[str, Fit]:
    out = {}
    for joint, name in enumerate(structure.robot.joints):
        rows = equations.joint == joint
        out[name] = fit(residual[rows], equations.torque[rows], equations.variance[rows])
    return out


def fit(residual: Array, torque: Array, variance: Array) -> Fit:
    """Return how well a model follows one joint: residual, torque and noise variance of its rows [R]."""
    mse = float(np.mean(residual**2))
    noise = float(np.mean(variance))
    size = float(np.sum(torque**2))
    return Fit(
        mse,
        float(np.sqrt(mse)),
        noise if np.isfinite(noise) else None,
        float(np.sqrt(np.sum(residual**2) / size)) if size else 0.0,
    )
