"""Validation: a model's prediction beside a recording that it has not seen, and where a model is worse than none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import EffortChecks, contradictions, taken_as_declared
from robot_ident.estimation.equations import fit
from robot_ident.estimation.prediction import as_predicted, processing_of, shown_low_pass, with_payload_found
from robot_ident.model.model import Fit, Model
from robot_ident.recording.checks import still_notes
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import SoftPeriodicLowPass
from robot_ident.signals.motion import Array, Mask, Motion

_BEYOND_NOISE = 4.0  # times the noise's variance: where a joint only holds still, error and torque are both noise
_ABSURD = 10.0  # times the torque itself, by which a model errs where efforts are in another unit or of another side
_NAMED = 3  # joints that the sentence names


def residual_on(model: Model, measured: Measurement) -> dict[str, Fit]:
    """Return by joint how well a model follows a recording, tau - Phi theta of the rows that count (eq. 1).

    A joint of which no row counts is left out. The noise is the recording's own where its repetitions tell it, else
    that of the model's recordings.
    """
    share = measured.low_pass.independent if measured.low_pass else 1.0
    known = np.array(model.noise.torque_variance, dtype=float) * share  # None: nan
    noise = np.where(np.isfinite(measured.averaged_variance), measured.averaged_variance, known)
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    error = measured.passed(measured.torque - model.predict(measured.motion))
    return _fits(model.robot, error, torque, used, noise)


def mean_square_errors(model: Model, measured: Measurement) -> Array:
    """Return the mean square error [n] of a model on a measurement, (Nm)^2; 0 of a joint of which no row counts."""
    fits = residual_on(model, measured)
    return np.array([fits[joint].mse if joint in fits else 0.0 for joint in model.robot.joints])


def _fits(robot: Robot, error: Array, torque: Array, counted: Mask, noise: Array) -> dict[str, Fit]:
    """Return by joint what errors and torques [R, n] amount to over the rows that are counted, of those with some."""
    return {
        joint: fit(error[rows, k], torque[rows, k], np.full(np.count_nonzero(rows), noise[k]))
        for k, (joint, rows) in enumerate(zip(robot.joints, counted.T, strict=True))
        if rows.any()
    }


def unusable(model: Model, source: str, residual: Mapping[str, Fit]) -> str | None:
    """Return a line that says at which joints a model is worse than none on a recording, None where it is nowhere:
    where predicting no torque at all would err less, rms(tau - Phi theta) > rms(tau), beyond the noise.
    """
    beyond = {name: one for name, one in residual.items() if one.mse > _BEYOND_NOISE * (one.noise_variance or 0.0)}
    worst = [name for name, one in beyond.items() if (one.relative or 0.0) > 1.0]
    worst.sort(key=lambda name: -residual[name].rms)
    if not worst:
        return None
    words = []
    for name in worst[:_NAMED]:
        unit = model.robot.torque_unit(model.robot.joint_index(name))
        takes = residual[name].rms / (residual[name].relative or 1.0)
        words.append(f"{residual[name].rms:.3g} {unit} at {name}, which takes {takes:.3g}")
    more = f" and at {len(worst) - _NAMED} more joints" if len(worst) > _NAMED else ""
    bag = Path(source).name
    seen = ", ".join(dict.fromkeys(Path(one["source"]).name for one in model.recordings))
    out = "" if model.physical is not None else ", or with --physical"
    return (
        f"on {bag} the model errs by more than the torque itself, rms {', '.join(words)}{more}: not usable beyond the"
        f" motions of {seen or 'the recordings that it rests on'}; identify with {bag} too{out}"
    )


def unusable_on(model: Model, validation: Sequence[Measurement]) -> tuple[str, ...]:
    """Return such a line for every validation recording on which a model is worse than none."""
    lines = (unusable(model, measured.source, residual_on(model, measured)) for measured in validation)
    return tuple(line for line in lines if line)


def refuse_foreign(measurements: Sequence[Measurement], robot: Robot) -> None:
    """Raise InputError where efforts are not made by the motion, clocks of recordings run at different paces, or weight
    is that of another gravity than declared: whatever a model lacked of them would be no physics.
    """
    checks = EffortChecks(measurements, robot)
    foreign, gravity = checks.foreign() or checks.clocks_apart(), checks.gravity()
    if foreign:
        raise InputError(foreign)
    if gravity is not None:
        raise InputError(f"{gravity.told(robot)} and identify anew")


def refuse_misdeclared(model: Model, measurements: Sequence[Measurement]) -> None:
    """Raise InputError where efforts are a tenth or less of what a model makes of a motion, and a declaration that they
    contradict tells why. A model that was identified as declared all the same stands.
    """
    if taken_as_declared(model.notes):
        return
    absurd = [
        measured
        for measured in measurements
        if any((one.relative or 0.0) > _ABSURD for one in residual_on(model, measured).values())
    ]
    for measured in absurd:
        try:
            contradictions([measured], model.robot)
        except InputError as error:
            which = "" if len(absurd) == len(measurements) else f"{measured.source} alone: "
            raise InputError(f"{which}{error}") from error


_TOUCHED = 0.1  # of a filtered value: the share of standstill from which on it counts as standstill


@dataclass(frozen=True)
class Validation:
    """Residuals on an independent motion, low-passed at `low_pass_hz`; samples at standstill apart, where stiction
    hides the torque. trouble: why the model can't be used on this motion, None where it can.
    """

    low_pass_hz: float
    residual: Mapping[str, Fit]
    standstill: Mapping[str, Fit]
    notes: tuple[str, ...]
    trouble: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return what `validate --json` prints."""
        return {
            "schema": "robot_ident/validation/1",
            "low_pass_hz": self.low_pass_hz,
            "residual": {joint: asdict(fit) for joint, fit in self.residual.items()},
            "standstill": {joint: asdict(fit) for joint, fit in self.standstill.items()},
            "notes": [*self.notes, *([self.trouble] if self.trouble else [])],
        }


def validate(model: Model, recording: Recording, *, low_pass: float | None = None) -> Validation:
    """Predict an independent recording; torque, prediction and noise pass the same zero-phase low pass: that of
    `predict` (`shown_low_pass`), or `low_pass` [Hz]. Cycles of production data are averaged as where a model is
    identified; all else is taken as one pass.

    Raises InputError where the recording isn't of the model's robot, of another pose than it holds, or never moves.
    """
    recording = with_payload_found(model, recording)
    cutoff = low_pass or shown_low_pass(model, recording)
    measured = _measured(model, recording, cutoff)
    torque = measured.passed(measured.torque)
    error = torque - measured.passed(model.predict(measured.motion))
    noise = _noise(model, measured) if measured.cycles is None else _noise_of_cycles(model, measured)
    counted = moving_rows(measured)
    rest = ~counted if measured.unknown is None else ~counted & ~measured.unknown[measured.rows]
    moving, still = (_fits(model.robot, error, torque, rows, noise) for rows in (counted, rest))
    if not moving:
        raise InputError(f"{recording.source}: no joint moves; nothing can be validated")
    notes = model.leading((*measured.notes, *still_notes(measured)))
    return Validation(cutoff, moving, still, notes, unusable(model, recording.source, moving))


def moving_rows(measured: Measurement) -> Mask:
    """Return the rows [R, n] that count: none at standstill, where stiction hides the torque, or filtered with it."""
    touched = measured.passed(measured.standstill.astype(float)) > _TOUCHED
    return np.asarray(measured.used[measured.rows] & ~touched)


def _measured(model: Model, recording: Recording, cutoff: float) -> Measurement:
    """Return the mean cycle of production data, anything else as one pass, low-passed at `cutoff` [Hz]."""
    own = processing_of(model)
    if own.periodic is not False:
        cycles = replace(own, base_frequency=None, low_pass=cutoff, decimate=1, periodic=None)
        found = process(recording, model.robot, cycles)
        if found.cycles is not None:
            return found
    return process(recording, model.robot, replace(as_predicted(model, recording), low_pass=cutoff))


def _noise_of_cycles(model: Model, measured: Measurement) -> Array:
    """Return the variance [n] of what noise alone leaves between measured and predicted torque of the mean cycle.

    The torque's is its scatter from cycle to cycle. Position noise of variance s^2 a row reaches the accelerations by
    the lines that the motion takes: s^2 2 / N sum_k (share_k gain_k w_k^2)^2.
    """
    low_pass, share, variance = measured.low_pass, measured.line_share, measured.averaged_position_variance
    if not isinstance(low_pass, SoftPeriodicLowPass) or share is None or variance is None:
        raise TypeError("cycles are averaged and low-passed")
    rates = 2.0 * np.pi * low_pass.frequency * np.arange(len(share))
    passed = share * (low_pass.gain[: len(share)] * rates**2)[:, None]
    acceleration = variance * 2.0 / low_pass.samples * np.sum(passed**2, axis=0)
    return np.asarray(measured.averaged_variance + _squared_inertia(model, measured.motion) @ acceleration)


def _noise(model: Model, measured: Measurement) -> Array:
    """Return the variance [n] of what noise alone leaves between measured and predicted torque, low-passed; nan where
    unknown.

    Torque noise passes the filter; what differentiation errs by reaches the prediction through M(q) ddq.
    """
    if measured.low_pass is None or measured.acceleration_error is None:
        raise TypeError("validation compares low-passed torques of one pass")
    torque = np.array(model.noise.torque_variance, dtype=float) * measured.low_pass.independent
    return np.asarray(torque + _squared_inertia(model, measured.motion) @ measured.acceleration_error)


def _squared_inertia(model: Model, motion: Motion) -> Array:
    """Return the mean square of every entry of the model's mass matrix M(q) along a motion [n, n]."""
    some = motion[:: max(1, motion.samples // 40)]
    mass = model.structure.sensitivity(some, model.linear).inertia
    return np.asarray(np.mean(mass**2, axis=0) * model.structure.scales[:, None] ** 2)
