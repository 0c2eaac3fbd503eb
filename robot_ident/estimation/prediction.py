"""The model's torque along a recording, with a band that holds what the model is known not to know.

A recording is taken as the model takes it: processed alike, of what its hand carried what the model knows, and joints
that the model holds have to stand where it does. Positions are differentiated as far as what the low pass takes from
the motion weighs more, in the torque that both make, than what it leaves of the encoders' noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.least_squares import root_of
from robot_ident.estimation.payload import bare, identify_payload
from robot_ident.model.derivatives import torque_derivatives
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import STILL, held_angles, still_notes, still_part
from robot_ident.recording.clock import even_samples, read_clock, roughness
from robot_ident.recording.conditions import KnownPayload
from robot_ident.recording.effort import per_reported_ampere
from robot_ident.recording.measurement import DEFAULT_LOW_PASS, Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.recording.repairs import repaired
from robot_ident.recording.torque_channel import chain_of
from robot_ident.signals.filters import ZeroPhaseLowPass, there_and_back
from robot_ident.signals.fourier import power_spectrum
from robot_ident.signals.motion import Array, Motion


def held_by(model: Model) -> Mapping[str, float]:
    """Return the joints that a model was identified with held, and where [rad, m]; its parameters hold there alone."""
    held: Mapping[str, float] = model.provenance.get("options", {}).get("held") or {}
    return held


def at_pose(model: Model, recording: Recording) -> Recording:
    """Return the part of a recording in which the joints that a model holds stand; all of it where they aren't in it.

    Raises InputError where they move, or stand elsewhere: the model says nothing of the arm there.
    """
    angles = held_angles(recording, [name for name in held_by(model) if name in recording.names], {})
    part = still_part(recording, angles, "take a model in which it moves")
    refuse_elsewhere(model, recording.source, angles)
    return part


def refuse_elsewhere(model: Model, source: str, angles: Mapping[str, float]) -> None:
    """Raise InputError where a joint that a model holds stands at another angle [rad, m]."""
    held = held_by(model)
    for name, angle in angles.items():
        if abs(angle - held.get(name, angle)) > 2.0 * STILL:
            raise InputError(
                f"{source}: {name} stands at {angle:.4g}, the model holds it at {held[name]:.4g};"
                " its parameters depend on the pose"
            )


def measured_for(model: Model, recording: Recording) -> Measurement:
    """Return a recording processed as a model's own were, less the torque of its payload.

    Raises InputError where it can't be used, or its payload is unknown and can't be told from it.
    """
    return process(with_payload_found(model, recording), model.robot, processing_of(model))


def processing_of(model: Model) -> Processing:
    """Return how a model's recordings were processed."""
    return Processing(**dict(model.processing))


def as_predicted(model: Model, recording: Recording) -> Processing:
    """Return how a recording is processed for a model's torque along it: as one pass, low-passed as the model says,
    differentiated at least cost.
    """
    own = processing_of(model)
    wide = prediction_bandwidth(recording, model.structure, model.linear, own)
    shown = replace(own, low_pass=shown_low_pass(model, recording), derivative_bandwidth=wide, velocity_bandwidth=wide)
    return replace(shown, periodic=False, base_frequency=None, decimate=1)


def shown_low_pass(model: Model, recording: Recording) -> float:
    """Return the low pass [Hz] that a model's torque along a recording takes, in predictions and in validations: its
    band where one was found, else the one that its recordings took, else 10 Hz; no more than the recording can take:
    four fifths of half of its sample rate (10 Hz: two fifths), and what its torque channel lets be undone.
    """
    own, dt = processing_of(model), read_clock(recording).dt
    stated = own.band or own.low_pass
    most = 0.4 / dt if stated else 0.2 / dt
    channel = chain_of(model.robot, own.anti_alias, recording.source, 1.0 / dt, 0.0)
    return min(stated or DEFAULT_LOW_PASS, most, channel.bandwidth)


def with_payload_found(model: Model, recording: Recording) -> Recording:
    """Return a recording whose payload, where its conditions leave it open, is the one that the model's recordings
    told under the same name; else what this recording alone tells of it on the model's arm. Where the model holds
    joints, the part in which they stand there.
    """
    recording = at_pose(model, repaired(recording, model.robot))
    conditions = recording.conditions
    if not conditions.estimated or conditions.payload is not None:
        return recording
    known, notes = payload_in(model, recording), recording.notes
    if known is None:
        bared = replace(recording, conditions=bare(conditions))
        measured = process(bared, model.robot, processing_of(model))
        found = identify_payload([measured], model, part=conditions.part)
        known = found.body.known
        notes = (*notes, f"payload found by this recording on the model's arm: {found.body.in_words}", *found.notes)
    return replace(recording, conditions=replace(conditions, payload=known), notes=notes)


def payload_in(model: Model, recording: Recording) -> KnownPayload | None:
    """Return an unknown payload as the model has it, if at all: one without a name is known by its recordings."""
    named = recording.conditions.body
    for one in model.payloads:
        files = [Path(source).name for source in one["recordings"]]
        if one["name"] == named and (named or Path(recording.source).name in files):
            return KnownPayload(one["mass"], tuple(one["centre"]), tuple(one["inertia"]))
    return None


_BAND = 1.96  # standard deviations of 95 % of a normal distribution
_FURTHER = 0.1  # of the range and of the speed: more is beyond what was identified
_STEP = 1e-4  # share by which an inner parameter is moved to see what the torque makes of it
_ROWS = 20_000  # whose columns are held at once


@dataclass(frozen=True)
class Prediction:
    """Torque [N, n] at instants t [N] s of the motion, its standard deviation [N, n] by the parameters' covariance,
    and the half width [N, n] of a band that holds 95 % of the noise-free torque; in Nm, N, or the A of the joint's own
    drive where its gain is unknown (`units`).

    misfit [n]: rms of what the model left unexplained, beyond the noise, where it was identified; it is in the band.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
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

    As in a validation positions are differentiated without phase, and the torque passes a zero-phase low pass
    (`shown_low_pass`), since differentiated noise is all that it holds beyond. Raises InputError where the recording
    isn't of the model's robot, or of another pose than it holds.
    """
    recording = at_pose(model, recording)
    measured = process(recording, model.robot, as_predicted(model, recording), motion_only=True)
    made = predict_motion(
        model, recording.t[0] + measured.dt * np.arange(measured.motion.samples), measured.motion, measured.passed
    )
    carried = payload_in(model, recording) if recording.conditions.estimated else recording.conditions.payload
    torque = made.torque
    if carried is not None:
        torque = torque + measured.passed(carried.torque(model.robot, measured.motion)) / per_reported_ampere(
            model.robot
        )
    notes = model.leading((*measured.notes, *made.notes, *still_notes(measured)))
    return replace(made, torque=torque, start_ns=recording.start_ns, notes=notes)


def predict_motion(
    model: Model, t: Array, motion: Motion, passed: Callable[[Array], Array] = lambda x: x
) -> Prediction:
    """Return the model's torque along a motion that is known exactly at instants t [N] s: one that is planned (eq. 1).

    The band holds 95 % of the torque that the motion will take, as far as what the model lacks is as large as where it
    was identified; the notes say where the motion goes further than that. passed: the low pass that the torque takes.
    """
    std = standard_deviation(model, motion, passed)
    fits = [model.residual[joint] for joint in model.robot.joints]
    misfit = np.sqrt([max(fit.mse - (fit.noise_variance or 0.0), 0.0) for fit in fits])
    ampere = per_reported_ampere(model.robot)
    return Prediction(
        joints=model.robot.joints,
        units=tuple(model.robot.torque_unit(joint) for joint in range(model.robot.n)),
        t=t,
        motion=motion,
        torque=passed(model.predict(motion)) / ampere,
        std=std / ampere,
        band=_BAND * np.sqrt(std**2 + misfit**2) / ampere,
        misfit=misfit / ampere,
        start_ns=0,
        notes=model.leading(beyond_notes(model, motion)),
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
    """Return the standard deviation [N, n] Nm of the predicted torque: diag(J C J')^1/2, J = d tau / d theta."""
    root = root_of(model.covariance)
    sensitivity = model.structure.columns(motion, model.linear)
    if model.structure.inner:
        sensitivity = np.concatenate([sensitivity, _inner(model, motion)], axis=2)
    sensitivity = passed(sensitivity)
    out = np.empty(sensitivity.shape[:2])
    for begin in range(0, len(out), _ROWS):
        rows = slice(begin, begin + _ROWS)
        out[rows] = np.linalg.norm(sensitivity[rows] @ root, axis=2)
    return out


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


_FINER = 0.84  # from one bandwidth to the next
_LEAST = 0.02  # of the widest bandwidth, where the search ends
_IDLE = 1e-6  # of the largest variance of a joint's torque: a joint that does less counts as if it did so much
_STATES = 200  # of the motion, over which the torque's derivatives are averaged


def prediction_bandwidth(
    recording: Recording, structure: Structure, values: Array, processing: Processing
) -> float | None:
    """Return to how many Hz positions are differentiated so that the torque of a structure with values [p] errs least:
    `band_derivative` at most, and what `processing` states where it has none.

    Position noise of variance s^2 a sample, white (third differences tell it), reaches the torque through M(q) ddq; the
    low pass H, without phase, takes its share of the motion itself. Of both together Stein's estimate of the squared
    error ("Estimation of the mean of a multivariate normal distribution", 1981) needs nothing but the record: up to a
    constant, sum over f of w^4 ((H^2 - 2 H) |Q|^2 + 2 H s^2). Joints count by the variance of their torque.
    """
    if processing.band_derivative is None:
        return processing.derivative_bandwidth
    joints = structure.robot.joints
    own = recording.with_joints(joints)
    clock = read_clock(own)
    widest = min(processing.band_derivative, 0.4 / clock.dt)
    q, _, _ = even_samples(own, clock)
    smooth = ZeroPhaseLowPass(widest, clock.dt, len(q))
    step = max(1, len(q) // _STATES)
    motion = Motion(q[::step], smooth.apply(q, 1)[::step], smooth.apply(q, 2)[::step], dt=clock.dt * step)
    inertia = torque_derivatives(structure, motion, values).acceleration
    torque = (structure.columns(motion, values) @ values).var(axis=0)
    # what an error of each joint's acceleration is worth, in shares of all joints' torque
    worth = np.mean(inertia**2, axis=0).T @ (1.0 / np.maximum(torque, max(_IDLE * torque.max(), 1e-300)))
    power = power_spectrum(q)
    frequency = np.fft.rfftfreq(len(q), clock.dt)
    scale = (2.0 * np.pi * frequency) ** 4
    moved, noise = scale * (power @ worth), scale * float(roughness(q) ** 2 @ worth)

    def error(cutoff: float) -> float:
        gain = there_and_back(frequency, cutoff)
        return float(np.sum((gain**2 - 2.0 * gain) * moved + 2.0 * gain * noise))

    count = int(np.log(_LEAST) / np.log(_FINER)) + 1
    return min((widest * _FINER**k for k in range(count)), key=error)
