"""A model refitted with further effects, and its error on recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.identify import estimate, with_scale_spread
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.signals.motion import Array


def extend(model: Model, measurements: Sequence[Measurement], effects: Sequence[Effect]) -> list[Model]:
    """Return the model refitted as it is, then with one effect more each time."""
    before = list(model.provenance.get("added", []))
    kept = [note for note in model.notes if taken_as_declared([note])]
    processing = Processing(**dict(model.processing))
    steps = []
    for count in range(len(effects) + 1):
        structure = model.structure.with_further(effects[:count])
        fitted = estimate(measurements, structure, estimator=model.estimator, processing=processing)
        labels = [*before, *(effect.label for effect in effects[:count])]
        provenance = {**model.provenance, "added": labels}
        fitted = replace(fitted, base=model.base, notes=(*kept, *fitted.notes), provenance=provenance)
        steps.append(with_scale_spread(fitted))
    return steps


def mean_square_errors(model: Model, measured: Measurement) -> Array:
    """Return the mean square error [n] of a model on a measurement, (Nm)^2, of the rows that count."""
    error = measured.passed(measured.torque - model.predict(measured.motion))
    used = measured.used[measured.rows]
    return np.asarray(np.sum(np.where(used, error**2, 0.0), axis=0) / np.maximum(used.sum(axis=0), 1))
