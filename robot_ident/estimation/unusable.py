"""Where a model is worse than none: on a recording that no fit has seen it errs by more than the torque itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.effort_checks import EffortChecks, contradictions, taken_as_declared
from robot_ident.estimation.identify import fit
from robot_ident.model.model import Fit, Model
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot

_BEYOND_NOISE = 4.0  # times the noise's variance: where a joint only holds still, error and torque are both noise
_ABSURD = 10.0  # times the torque itself, by which a model errs where efforts are in another unit or of another side
_NAMED = 3  # joints that the sentence names


def residual_on(model: Model, measured: Measurement) -> dict[str, Fit]:
    """Return by joint how well a model follows a recording, tau - Phi theta of the rows that count (eq. 1).

    A joint of which no row counts is left out. The noise is the recording's own where its repetitions tell it, else
    that of the model's recordings.
    """
    share = measured.low_pass.independent if measured.low_pass else 1.0
    known = np.array([np.nan if v is None else v for v in model.noise.torque_variance]) * share
    noise = np.where(np.isfinite(measured.averaged_variance), measured.averaged_variance, known)
    torque, used = measured.passed(measured.torque), measured.used[measured.rows]
    error = measured.passed(measured.torque - model.predict(measured.motion))
    return {
        joint: fit(error[rows, k], torque[rows, k], np.full(np.count_nonzero(rows), noise[k]))
        for k, (joint, rows) in enumerate(zip(model.robot.joints, used.T, strict=True))
        if rows.any()
    }


def is_unusable(residual: Fit) -> bool:
    """Return whether predicting no torque at all would err less: rms(tau - Phi theta) > rms(tau), beyond the noise."""
    noise = residual.noise_variance or 0.0
    return residual.relative is not None and residual.relative > 1.0 and residual.mse > _BEYOND_NOISE * noise


def unusable(model: Model, source: str, residual: Mapping[str, Fit]) -> str | None:
    """Return a line that says at which joints a model is worse than none on a recording, None where it is nowhere."""
    worst = sorted((name for name, one in residual.items() if is_unusable(one)), key=lambda name: -residual[name].rms)
    if not worst:
        return None
    words = []
    for name in worst[:_NAMED]:
        unit = model.robot.torque_unit(model.robot.joint_index(name))
        words.append(f"{residual[name].rms:.3g} {unit} at {name}, which takes {_torque(residual[name]):.3g}")
    more = f" and at {len(worst) - _NAMED} more joints" if len(worst) > _NAMED else ""
    bag = Path(source).name
    seen = ", ".join(dict.fromkeys(Path(one["source"]).name for one in model.recordings))
    out = "" if model.physical is not None else ", or with --physical"
    return (
        f"on {bag} the model errs by more than the torque itself, rms {', '.join(words)}{more}: not usable beyond the"
        f" motions of {seen or 'the recordings that it rests on'}; identify with {bag} too{out}"
    )


def unusable_on(model: Model, validation: Sequence[Measurement]) -> tuple[str, ...]:
    """Return such a line for every recording kept aside on which the model is worse than none, before them one where it
    can't follow its own.
    """
    lines = (unusable(model, measured.source, residual_on(model, measured)) for measured in validation)
    return tuple(line for line in (model.trouble, *lines) if line)


def _torque(residual: Fit) -> float:
    """Return the rms torque [Nm] that a residual stands beside."""
    return residual.rms / residual.relative if residual.relative else 0.0


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
