"""Identification: from recordings to a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.solve import ESTIMATORS, solve
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot


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
    found = solve(measurements, structure, estimator)
    equations, linear = found.equations, found.values[: len(structure.parameters)]
    _, logdet = np.linalg.slogdet(found.covariance[: len(linear), : len(linear)])
    return Model(
        structure=found.structure,
        values=found.values,
        covariance=found.covariance,
        estimator=estimator,
        noise=_noise(measurements),
        residual=_fits(equations, equations.torque - equations.phi @ linear, structure),
        condition_number=found.condition_number,
        log10_det_covariance=float(logdet / np.log(10.0)),
        processing=asdict(processing or Processing()),
        notes=(*structure.notes, *(f"{m.source}: {note}" for m in measurements for note in m.notes), *found.notes),
    )


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
