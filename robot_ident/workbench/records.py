"""What is written of a step for the browser: the dictionaries that the commands print, and the rows of every
recording, measured and predicted, with what they depend on.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from robot_ident.diagnosis.diagnosis import Diagnosis
from robot_ident.effects import candidates_of
from robot_ident.estimation.validation import unusable_on
from robot_ident.files import whole, write_text
from robot_ident.model.model import Model
from robot_ident.recording.measurement import Measurement
from robot_ident.residuals.beside import noise_variance
from robot_ident.residuals.comparison import Comparison
from robot_ident.signals.motion import Array, Mask
from robot_ident.workflow.preview import Preview
from robot_ident.workflow.steps import unseen_errors


def about(measured: Measurement, validation: bool) -> dict[str, Any]:
    """Return what the figures say of a recording."""
    return {
        "name": measured.source,
        "validation": validation,
        "periods": measured.periods,
        "base_frequency": measured.base_frequency,
        "dt": measured.dt * measured.decimate,
        "samples": measured.motion.samples,
        "noise_variance": measured.averaged_variance.tolist(),
        "notes": list(measured.notes),
    }


def comparison(found: Comparison, model: Model, validation: Sequence[Measurement]) -> dict[str, Any]:
    """Return a comparison as `compare --json` prints it, with its regions in words, why the model can't be used at
    all, and a line on every validation recording on which it is worse than none.
    """
    joints = []
    for number, joint in enumerate(found.joints):
        words = [region.in_words(model.robot, number) for region in joint.worst]
        joints.append({**joint.to_dict(), "in_words": joint.in_words, "worst_in_words": words})
    robot = model.robot
    return {
        "joints": joints,
        "notes": list(found.notes),
        "trouble": model.trouble,
        "unusable": list(unusable_on(model, validation)),
        "units": [robot.torque_unit(k) for k in range(robot.n)],
        "prismatic": [bool(one) for one in robot.prismatic],
        "effects": list(model.structure.labels),
        "possible": [effect.label for effect in candidates_of(model.structure)],
        "parameters": [
            {"name": p.name, "value": float(v), "std": float(s), "unit": p.unit, "effect": p.effect, "joint": p.joint}
            for p, v, s in zip(model.parameters, model.values, model.std, strict=True)
        ],
    }


def errors(model: Model, compared: Comparison, validation: Sequence[Measurement]) -> dict[str, Any]:
    """Return the mean square errors by joint [(Nm)^2] and the noise of both: on training as `compare` has them, on
    validation as `add` does, the mean over recordings. Where a recording to validate on doesn't tell its noise, the
    model's stands for it, as in the report.
    """
    unseen = [noise_variance(model, measured) for measured in validation]
    return {
        "training": {joint.name: joint.residual_mse for joint in compared.joints},
        "noise": {joint.name: joint.noise_variance for joint in compared.joints},
        "validation": unseen_errors(model, validation),
        "validation_noise": dict(zip(model.robot.joints, np.mean(unseen, axis=0), strict=True)) if unseen else None,
    }


def diagnosis(found: Diagnosis, saved: Mapping[str, str]) -> dict[str, Any]:
    """Return a diagnosis as `diagnose --json` prints it, with the labels and words of its candidates.

    saved: what a file that a command names is called once it was saved.
    """
    data = found.to_dict()
    for finding, candidate in zip((*found.missing, *found.others), data["candidates"], strict=True):
        effect = finding.effect
        candidate |= {"label": effect.label, "meaning": effect.meaning, "equation": effect.equation}
        candidate |= {"can_be_added": effect.regression, "evidence": effect.evidence}
        for path, name in saved.items():
            candidate["experiment"] = candidate["experiment"] and candidate["experiment"].replace(path, name)
    return {**data, "in_words": found.in_words, "named": [finding.label for finding in found.missing]}


def preview_of(preview: Preview) -> dict[str, Any]:
    """Return what an effect would do to a model, with its words."""
    effect = preview.effect
    return {
        "label": effect.label,
        "meaning": effect.meaning,
        "equation": effect.equation,
        "before": preview.before,
        "after": preview.after,
        "validation_before": preview.validation_before,
        "validation_after": preview.validation_after,
        "parameters": [asdict(one) for one in preview.parameters],
    }


def write_json(path: Path, data: Mapping[str, Any]) -> None:
    """Write a dictionary, whole or not at all; null for numbers that aren't finite."""
    write_text(path, json.dumps(_finite(data), indent=1), force=True)


def _finite(value: Any) -> Any:
    """Return data with null for numbers that aren't finite."""
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


@dataclass(frozen=True)
class Rows:
    """The rows [N] of one recording: t [s]; q, dq, ddq, since (the last reversal [s]) and measured torque, all [N, n];
    weight [N, n] (1 / Nm, 0 where a row does not count) and dof [n] as `compare` takes them.
    """

    t: Array
    q: Array
    dq: Array
    ddq: Array
    since: Array
    measured: Array
    weight: Array
    dof: Array


@dataclass(frozen=True)
class Lines:
    """The lines of one recording's residual: frequency [K] Hz; excited [K]: those that the motion itself holds; noise
    [K, n] Nm rms of a line, nan where unknown.
    """

    frequency: Array
    excited: Mask
    noise: Array


_Kind = TypeVar("_Kind", Rows, Lines)


def write_arrays(path: Path, arrays: Mapping[str, Array]) -> None:
    """Write named arrays to a file, whole or not at all."""
    with whole(path, force=True) as draft:
        np.savez(draft, **arrays)  # type: ignore[arg-type]


def to_arrays(kind: type[Rows] | type[Lines], every: Sequence[Any]) -> dict[str, Array]:
    """Return what a kind holds of all recordings as named arrays."""
    return {f"{k}.{name}": getattr(one, name) for k, one in enumerate(every) for name in kind.__dataclass_fields__}


def from_arrays(kind: type[_Kind], arrays: Mapping[str, Array]) -> tuple[_Kind, ...]:
    """Return what was held of all recordings; the reverse of `to_arrays`."""
    names = tuple(kind.__dataclass_fields__)
    every: list[Any] = [[arrays[f"{k}.{name}"] for name in names] for k in range(len(arrays) // len(names))]
    return tuple(kind(*one) for one in every)
