"""A model refitted with further effects, drives' gains found anew where it has some, for what is missing from a model
gains make up for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from robot_ident.effects import Effect
from robot_ident.estimation.drive_gains import robot_without, with_known_gains
from robot_ident.estimation.effort_checks import taken_as_declared
from robot_ident.estimation.identify import estimate, with_scale_spread
from robot_ident.model.model import Model
from robot_ident.model.structure import Structure
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.process import process
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array


def extend(model: Model, measurements: Sequence[Measurement], effects: Sequence[Effect]) -> list[Model]:
    """Return the model refitted as it is, then with one effect more each time."""
    kept = [note for note in model.notes if taken_as_declared([note])]
    processing = Processing(**dict(model.processing))
    steps = []
    for count in range(len(effects) + 1):
        structure = model.structure.with_further(effects[:count])
        fitted = estimate(measurements, structure, estimator=model.estimator, processing=processing)
        fitted = replace(fitted, notes=(*kept, *fitted.notes))
        steps.append(_of(model, fitted, [effect.label for effect in effects[:count]]))
    return steps


def _of(model: Model, fitted: Model, labels: Sequence[str]) -> Model:
    """Return a model that was fitted anew as what came of another one by further effects."""
    provenance = {**model.provenance, "added": [*model.provenance.get("added", []), *labels]}
    return with_scale_spread(replace(fitted, base=model.base, provenance=provenance))


def mean_square_errors(model: Model, measured: Measurement) -> Array:
    """Return the mean square error [n] of a model on a measurement, (Nm)^2, of the rows that count."""
    error = measured.passed(measured.torque - model.predict(measured.motion))
    used = measured.used[measured.rows]
    return np.asarray(np.sum(np.where(used, error**2, 0.0), axis=0) / np.maximum(used.sum(axis=0), 1))


def tells_gains(model: Model, measurements: Sequence[Measurement]) -> bool:
    """Return whether a model's gains were estimated and these recordings can tell them: with and without a payload of
    which the mass is known.
    """
    conditions = [measured.conditions for measured in measurements]
    carried = {(one.body or "unnamed") if one.estimated else one.payload for one in conditions}
    weighed = any(one.part.mass if one.estimated else one.payload for one in conditions)
    return bool(_estimated(model)) and len(carried) > 1 and weighed


def extended(
    model: Model,
    measurements: Sequence[Measurement],
    recordings: Callable[[], Sequence[Recording]],
    effects: Sequence[Effect],
) -> list[Model]:
    """Return a model refitted as it is, then with one effect more each time; drive gains and payloads that the same
    recordings told are found anew with each, since what was missing they had made up for.

    measurements: of the `recordings`, which are asked for where gains are found. Raises InputError as `estimate` does.
    """
    if not tells_gains(model, measurements):
        return extend(model, measurements, effects)
    read, labels = recordings(), [effect.label for effect in effects]
    return [extended_with_gains(model, read, labels[:count]) for count in range(len(labels) + 1)]


def measured_anew(model: Model) -> bool:
    """Return whether a model makes other measurements of recordings than the one that it came from: by gains of drives,
    or payloads, that were found with it.
    """
    return bool(_estimated(model) or model.payloads)


def extended_with_gains(model: Model, recordings: Sequence[Recording], labels: Sequence[str]) -> Model:
    """Return a model refitted with effects `labels` beside its own, its drives' gains found anew from the recordings.

    Raises InputError where the recordings don't tell the gains, or don't excite a parameter.
    """
    robot = robot_without(model.robot, _estimated(model))
    processing = Processing(**dict(model.processing))
    measurements = [process(recording, robot, processing) for recording in recordings]
    structure = Structure.build(robot, [*(effect.label for effect in model.structure.added), *labels])
    known, structure, gains = with_known_gains(recordings, measurements, structure, processing)
    fitted = estimate(known, structure, estimator=model.estimator, processing=processing, gains=gains)
    return _of(model, fitted, labels)


def _estimated(model: Model) -> tuple[str, ...]:
    """Return the joints whose gain in Nm/A or N/A was estimated with the model."""
    return tuple(str(one["joint"]) for one in model.gains or () if one["unit"] != "A/A")
