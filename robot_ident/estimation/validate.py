"""Validation: a model's prediction beside a recording that it has not seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.identify import fit
from robot_ident.model.model import Fit, Model
from robot_ident.recording.continuous import DEFAULT_LOW_PASS
from robot_ident.recording.measurement import Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording


@dataclass(frozen=True)
class Validation:
    """Residuals on an independent motion, low-passed at `low_pass_hz`; samples at standstill apart, where stiction
    hides the torque.
    """

    low_pass_hz: float
    residual: Mapping[str, Fit]
    standstill: Mapping[str, Fit]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return what `validate --json` prints."""
        return {
            "schema": "robot_ident/validation/1",
            "low_pass_hz": self.low_pass_hz,
            "residual": {joint: asdict(fit) for joint, fit in self.residual.items()},
            "standstill": {joint: asdict(fit) for joint, fit in self.standstill.items()},
            "notes": list(self.notes),
        }


def validate(model: Model, recording: Recording, *, low_pass: float | None = None) -> Validation:
    """Predict an independent recording; torque, prediction and noise pass the same zero-phase low pass (10 Hz unless
    told).

    Raises InputError where the recording isn't of the model's robot or never moves.
    """
    used = Processing(**dict(model.processing)) if model.processing else Processing()
    cutoff = DEFAULT_LOW_PASS if low_pass is None else low_pass
    measured = process(
        recording, model.robot, replace(used, periodic=False, base_frequency=None, low_pass=cutoff, decimate=1)
    )
    predicted = measured.passed(model.predict(measured.motion))
    torque = measured.passed(measured.torque)
    share = measured.low_pass.independent if measured.low_pass else 1.0
    moving, still = {}, {}
    for joint, name in enumerate(model.robot.joints):
        sample = model.noise.torque_variance[joint]
        variance = np.full(len(torque), np.nan if sample is None else sample * share)
        residual = torque[:, joint] - predicted[:, joint]
        rows = measured.used[:, joint]
        if not rows.any():
            raise InputError(f"{recording.source}: {name} never moves; nothing can be validated")
        moving[name] = fit(residual[rows], torque[rows, joint], variance[rows])
        rest = ~rows
        if rest.any():
            still[name] = fit(residual[rest], torque[rest, joint], variance[rest])
    return Validation(cutoff, moving, still, measured.notes)
