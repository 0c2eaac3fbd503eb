"""Recordings that don't tell their noise: every joint is weighed by the residual that the model leaves on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement
from robot_ident.regression.evidence import Evidence, Trajectory, fitted
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Motion

_SAMPLES = 50.0  # a second per Hz of the low pass: enough to time a reversal
_ROWS = 4.0  # a second per Hz of the low pass: more say nothing new


def tells_noise(measured: Measurement) -> bool:
    """Return whether a recording tells the noise of its torque."""
    variance = measured.averaged_variance
    return bool(np.all(np.isfinite(variance)) and np.all(variance > 0))


def weighed_by_residual(measurements: Sequence[Measurement], structure: Structure) -> Evidence:
    """Return the evidence with every joint in units of the rms residual that the model leaves on it."""
    plain = [_plain(measured) for measured in measurements]
    rigid = tuple(structure.rigid_columns(t.motion) for t in plain)
    evidence = fitted(structure, tuple(plain), rigid)
    for _ in range(2):  # the weights of the joints and the fit settle together
        squared = np.sum([np.sum((r * (t.weight > 0)) ** 2, axis=0) for r, t in _newton(evidence)], axis=0)
        rows = np.sum([np.sum(t.weight > 0, axis=0) for t in plain], axis=0)
        sigma = np.sqrt(np.maximum(squared / np.maximum(rows, 1), 1e-300))
        evidence = fitted(structure, tuple(_scaled(t, sigma) for t in plain), rigid, evidence.memory)
    return evidence


def weighed_alike(measured: Measurement, evidence: Evidence) -> Trajectory:
    """Return a further recording in the units of an evidence whose joints are weighed by their residual."""
    first = evidence.trajectories[0]
    sigma = np.sqrt(first.measured.independent) / np.maximum(first.weight.max(axis=0), 1e-300)
    return _scaled(_plain(measured), sigma)


def _plain(measured: Measurement) -> Trajectory:
    """Return a recording in Nm, with weights of 1."""
    kept = _thinned(measured)
    weight = kept.used[kept.rows].astype(float)
    return Trajectory(
        kept, kept.motion, weight, kept.passed(kept.torque) * weight, weight.sum(axis=0) * kept.independent
    )


def _scaled(t: Trajectory, sigma: Array) -> Trajectory:
    """Return a recording in units of the rms residual sigma [n] of each joint."""
    weight = (t.weight > 0) * np.sqrt(t.measured.independent) / sigma
    return replace(t, weight=weight, y=t.measured.passed(t.measured.torque) * weight)


def _newton(evidence: Evidence) -> list[tuple[Array, Trajectory]]:
    """Return each trajectory's residual in Nm, zero where a row doesn't count."""
    pairs = zip(evidence.residual, evidence.trajectories, strict=True)
    return [(r / np.where(t.weight > 0, t.weight, 1.0), t) for r, t in pairs]


def _thinned(measured: Measurement) -> Measurement:
    """Return a low-passed measurement with no more samples and rows than its low pass leaves worth looking at."""
    low_pass = measured.low_pass
    if low_pass is None or measured.base_frequency is not None:
        return measured
    every = max(1, int(1.0 / (_SAMPLES * low_pass.cutoff * measured.dt)))
    if every > 1:
        smooth = ZeroPhaseLowPass(4.0 * low_pass.cutoff, measured.dt, measured.motion.samples)
        q, dq, ddq = (getattr(measured.motion, name)[::every] for name in ("q", "dq", "ddq"))
        measured = replace(
            measured,
            dt=measured.dt * every,
            motion=Motion(q, dq, ddq, dt=measured.dt * every, gravity=measured.motion.gravity),
            torque=smooth.apply(measured.torque)[::every],
            used=measured.used[::every],
            standstill=measured.standstill[::every],
            unknown=None if measured.unknown is None else measured.unknown[::every],
            low_pass=ZeroPhaseLowPass(low_pass.cutoff, measured.dt * every, len(q)),
            samples_per_period=len(q),
            decimate=max(1, measured.decimate // every),
        )
    most = max(1, int(1.0 / (_ROWS * low_pass.cutoff * measured.dt)))
    return replace(measured, decimate=max(measured.decimate, most))
