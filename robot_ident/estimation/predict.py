"""The model's torque along a recording, with a band that holds what the model is known not to know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.estimation.at_pose import at_pose
from robot_ident.estimation.for_model import payload_in, processing_of, within_rate
from robot_ident.model.model import Model
from robot_ident.recording.checks import still_notes
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array, Motion

_BAND = 1.96  # standard deviations of 95 % of a normal distribution
_FURTHER = 0.1  # of the range and of the speed: more is beyond what was identified
_STEP = 1e-4  # share by which an inner parameter is moved to see what the torque makes of it
_ROWS = 20_000  # whose columns are held at once


@dataclass(frozen=True)
class Prediction:
    """Torque [N, n] Nm at instants t [N] s of the motion, its standard deviation [N, n] by the parameters' covariance,
    and the half width [N, n] of a band that holds 95 % of the noise-free torque.

    misfit [n] Nm: rms of what the model left unexplained, beyond the noise, where it was identified; it is in the band.
    """

    joints: tuple[str, ...]
    t: Array
    motion: Motion
    torque: Array
    std: Array
    band: Array
    misfit: Array
    start_ns: int
    notes: tuple[str, ...]


def predict(model: Model, recording: Recording) -> Prediction:
    """Return the model's torque along a recording's positions, its efforts unused (eq. 1).

    As in a validation positions are differentiated without phase, and the torque passes a zero-phase low pass (10 Hz
    unless the model was made with another, or its band where one was found), since differentiated noise is all that it
    holds beyond. Raises InputError where the recording isn't of the model's robot,
    or of another pose than it holds.
    """
    recording = at_pose(model, recording)
    used = processing_of(model).for_prediction
    if used.band is not None:
        used = replace(used, low_pass=within_rate(used.band, recording))
    measured = process(recording, model.robot, used, motion_only=True)
    motion = measured.motion
    std = standard_deviation(model, motion, measured.passed)
    torque = model.predict(motion)
    carried = payload_in(model, recording) if recording.conditions.estimated else recording.conditions.payload
    if carried is not None:
        torque = torque + carried.torque(model.robot, motion)
    misfit = np.array([_misfit(model, joint) for joint in model.robot.joints])
    return Prediction(
        joints=model.robot.joints,
        t=recording.t[0] + measured.dt * np.arange(motion.samples),
        motion=motion,
        torque=measured.passed(torque),
        std=std,
        band=_BAND * np.sqrt(std**2 + misfit**2),
        misfit=misfit,
        start_ns=recording.start_ns,
        notes=(*measured.notes, *beyond_notes(model, motion), *still_notes(measured)),
    )


def predict_motion(model: Model, t: Array, motion: Motion) -> Prediction:
    """Return the model's torque along a motion that is known exactly at instants t [N] s: one that is planned (eq. 1).

    The band holds 95 % of the torque that the motion will take, as far as what the model lacks is as large as where it
    was identified; the notes say where the motion goes further than that.
    """
    std = standard_deviation(model, motion)
    misfit = np.array([_misfit(model, joint) for joint in model.robot.joints])
    return Prediction(
        joints=model.robot.joints,
        t=t,
        motion=motion,
        torque=model.predict(motion),
        std=std,
        band=_BAND * np.sqrt(std**2 + misfit**2),
        misfit=misfit,
        start_ns=0,
        notes=beyond_notes(model, motion),
    )


def beyond_notes(model: Model, motion: Motion) -> tuple[str, ...]:
    """Return a line for every joint that goes further or faster than in the recordings that the model rests on."""
    out = []
    for k, name in enumerate(model.robot.joints):
        reaches = [one["reach"][name] for one in model.recordings if name in one.get("reach", {})]
        if not reaches:
            continue
        low, high, top = min(r[0] for r in reaches), max(r[1] for r in reaches), max(r[2] for r in reaches)
        room = _FURTHER * (high - low)
        q, speed = motion.q[:, k], float(np.abs(motion.dq[:, k]).max())
        words = []
        if q.min() < low - room or q.max() > high + room:
            words.append(f"from {q.min():.3g} to {q.max():.3g}, identified from {low:.3g} to {high:.3g}")
        if speed > (1.0 + _FURTHER) * top:
            words.append(f"at up to {speed:.3g} a second, identified up to {top:.3g}")
        if words:
            out.append(f"{name} moves {' and '.join(words)}: there the band does not hold what the model may lack")
    return tuple(out)


def standard_deviation(model: Model, motion: Motion, passed: Callable[[Array], Array] = lambda x: x) -> Array:
    """Return the standard deviation [N, n] Nm of the predicted torque: diag(J C J')^1/2, J = d tau / d theta.

    passed: the low pass that the torque takes.
    """
    root = _root(model.covariance)
    sensitivity = model.structure.columns(motion, model.linear)
    if model.structure.inner:
        sensitivity = np.concatenate([sensitivity, _inner(model, motion)], axis=2)
    sensitivity = passed(sensitivity)
    out = np.empty(sensitivity.shape[:2])
    for begin in range(0, len(out), _ROWS):
        rows = slice(begin, begin + _ROWS)
        out[rows] = np.linalg.norm(sensitivity[rows] @ root, axis=2)
    return out


def _root(covariance: Array) -> Array:
    """Return R [p, p] with R R' = C; parameters of very different size keep their digits."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _inner(model: Model, motion: Motion) -> Array:
    """Return what the torque makes of each inner parameter [N, n, r], by central differences."""
    settings = model.values[len(model.structure.parameters) :]
    columns = []
    for place, value in enumerate(settings):
        step = _STEP * max(abs(float(value)), 1e-9)
        torques = []
        for sign in (1.0, -1.0):
            moved = settings.copy()
            moved[place] += sign * step
            torques.append(model.structure.with_settings(moved).columns(motion, model.linear) @ model.linear)
        columns.append((torques[0] - torques[1]) / (2.0 * step))
    return np.stack(columns, axis=2)


def _misfit(model: Model, joint: str) -> float:
    fit = model.residual[joint]
    return float(np.sqrt(max(fit.mse - (fit.noise_variance or 0.0), 0.0)))
