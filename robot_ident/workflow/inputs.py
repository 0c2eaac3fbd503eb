"""Models and recordings as every command takes them: read once, refused once, processed as the model says; and what
earlier ones tell already, for a design that goes on from there.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.bags import read_for
from robot_ident.errors import InputError
from robot_ident.estimation.identify import measured_anew
from robot_ident.estimation.prediction import Prediction, measured_for, predict_motion, refuse_elsewhere
from robot_ident.estimation.validation import residual_on, unusable
from robot_ident.files import refuse_twice
from robot_ident.model.model import Model
from robot_ident.model.model_file import is_model, read_model
from robot_ident.provenance import fingerprint, was_fitted
from robot_ident.recording.checks import refuse_copies, refuse_same_rows
from robot_ident.recording.measurement import Measurement, Source
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation
from robot_ident.trajectories.point_to_point import load_motion

if TYPE_CHECKING:
    from robot_ident.design.target import Target

_SAMPLE_RATE = 150.0  # Hz at which moves from point to point are looked at
_MOST_SAMPLES = 1_000_000  # of a planned motion: the columns of every one are held


@dataclass(frozen=True)
class Inputs:
    """Models and measurements, and where they were read from; those of `validation` never enter a fit.

    topic: of the joint states in the bags, None where the bags tell.
    """

    models: tuple[Model, ...]
    paths: tuple[str, ...]
    bags: tuple[str, ...]
    measurements: tuple[Measurement, ...]
    validation: tuple[Measurement, ...]
    validation_bags: tuple[str, ...] = ()
    topic: str | None = None

    def recordings(self) -> list[Recording]:
        """Read the recordings that models are fitted to once more, as they were recorded."""
        return [read_for(bag, self.models[0].robot, topic=self.topic) for bag in self.bags]

    def validated_for(self, model: Model) -> tuple[Measurement, ...]:
        """Return the validation recordings as a model of these inputs measures them."""
        if not measured_anew(model):
            return self.validation
        return tuple(_measured(model, bag, self.topic) for bag in self.validation_bags)

    def with_model(self, model: Model) -> Inputs:
        """Return the inputs with another model that came from theirs; measured anew where it measures otherwise."""
        given = replace(self, models=(model,))
        if not measured_anew(model):
            return given
        measured = tuple(_measured(model, bag, self.topic) for bag in self.bags)
        return replace(given, measurements=measured, validation=self.validated_for(model))


def read_inputs(words: Sequence[str], validation: Sequence[str], topic: str | None) -> Inputs:
    """Read models and recordings from one list; recordings are processed as the first model says."""
    paths = tuple(word for word in words if is_model(word))
    bags = tuple(word for word in words if word not in paths)
    if not paths:
        lost = [word for word in words if not os.path.exists(word)]
        if lost:
            raise InputError(f"{lost[0]}: no such file")
        raise InputError(f"none of {', '.join(words)} is a model; make one by robot_ident identify ... -o model.yaml")
    refuse_twice(bags)
    refuse_twice(validation)
    _refuse_fitted(bags, validation)
    models = tuple(read_model(path) for path in paths)
    recordings = [read_for(bag, models[0].robot, topic=topic) for bag in (*bags, *validation)]
    refuse_same_rows(recordings)
    every = [measured_for(models[0], recording) for recording in recordings]
    measured, unseen = tuple(every[: len(bags)]), tuple(every[len(bags) :])
    refuse_copies([*measured, *unseen])
    for bag, measurement in zip(validation, unseen, strict=True):
        _refuse_stranger(models[0], bag, measurement)
    return Inputs(models, paths, bags, measured, unseen, tuple(validation), topic)


def _refuse_fitted(bags: Sequence[str], validation: Sequence[str]) -> None:
    """Raise InputError where a recording is to be fitted and to be unseen."""
    fitted = {os.path.realpath(bag) for bag in bags}
    for bag in validation:
        if os.path.realpath(bag) in fitted:
            raise InputError(f"--validation {bag}: is one of the fitted recordings; give an independent one")


def _refuse_stranger(model: Model, bag: str, measured: Measurement) -> None:
    """Raise InputError for a recording of which the model predicts nothing: joints of other robots have like names."""
    found = residual_on(model, measured)
    if found and all(one.relative is None or one.relative > 1.0 for one in found.values()):
        raise InputError(
            f"{bag}: a recording of another robot than {model.robot.name}? at every joint the model errs by more than"
            f" the torque itself; if it is of this one: {unusable(model, bag, found) or 'nothing in it moves'}"
        )


def _measured(model: Model, bag: str, topic: str | None) -> Measurement:
    return measured_for(model, read_for(bag, model.robot, topic=topic))


def read_sources(
    bags: Sequence[str], model: Model, *, topic: str | None = None, heard: Callable[[str], None] = lambda what: None
) -> tuple[Source, ...]:
    """Return recordings as read and as measured for a model; InputError where one can't be used."""
    out = []
    for bag in bags:
        heard(f"reading {bag}")
        recording = read_for(bag, model.robot, topic=topic)
        out.append(Source(str(bag), fingerprint(bag), recording, measured_for(model, recording)))
    return tuple(out)


def fitted_to(model: Model, bag: str, recording: Recording) -> str:
    """Return that a model was fitted to a recording, or to one of which it holds samples or noise; or nothing.

    Its own recordings are read where they still are.
    """
    if was_fitted(bag, model.provenance):
        return f"{bag}: the model was fitted to it"
    for one in model.provenance.get("recordings", ()):
        if not os.path.exists(str(one.get("path"))):
            continue
        try:
            other = read_for(str(one["path"]), model.robot)
            refuse_same_rows([other, recording])
            refuse_copies([measured_for(model, other), measured_for(model, recording)])
        except InputError as error:
            if "the samples of" in str(error):
                return f"{error}: the model was fitted to {one['path']}"
    return ""


def refuse_repeated(training: Sequence[Source], validation: Sequence[Source]) -> None:
    """Raise InputError where a recording is given twice, or another one holds its samples or its noise."""
    every = [*training, *validation]
    refuse_same_rows([source.recording for source in every])
    refuse_copies([source.measured for source in every])


def read_excitations(named: Sequence[str], models: Sequence[Model]) -> list[tuple[str, Excitation]]:
    """Return the excitations that are named; where none is, those that the models say and that are still there."""
    paths = list(named)
    if not paths:
        noted = [model.provenance.get("options", {}).get("trajectory") or () for model in models]
        files = [file for one in noted for file in ([one] if isinstance(one, str) else one)]
        paths = list(dict.fromkeys(str(path) for path in files if Path(str(path)).is_file()))
    return [(path, Excitation.read(path)) for path in paths]


def prior_information(words: Sequence[str], target: Target, model: Model | None, *, bound: bool) -> Array | None:
    """Return the information [p, p] of recordings and models about a target's parameters, None where none are given.

    Recordings are processed as the model says (as usual without one). A model counts by the inverse of its covariance.
    """
    if not words:
        return None
    size = len(target.structure.parameters)
    out = np.zeros((size, size))
    bags = [word for word in words if not is_model(word)]
    for word in words:
        if word not in bags:
            out += _of_model(word, target)
    return out + _of_recordings(bags, target, model, bound) if bags else out


def _of_recordings(bags: Sequence[str], target: Target, model: Model | None, bound: bool) -> Array:
    from robot_ident.estimation.maximum_likelihood import information
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process

    refuse_twice(bags)
    processing = Processing(**dict(model.processing)) if model and model.processing else Processing()
    measurements = [process(read_for(bag, target.robot), target.robot, processing) for bag in bags]
    refuse_copies(measurements)
    return information(measurements, target.structure, target.values, bound=bound)


def _of_model(path: str, target: Target) -> Array:
    """Return the information of a model about the parameters that it shares with the target, the others set free."""
    found = read_model(path)
    if found.robot.joints != target.robot.joints:
        raise InputError(f"{path}: a model of robot {found.robot.name!r}, not of {target.robot.name!r}")
    names = {parameter.name: k for k, parameter in enumerate(found.parameters)}
    mine = [k for k, name in enumerate(target.structure.names) if name in names]
    theirs = [names[target.structure.names[k]] for k in mine]
    covariance = found.covariance[np.ix_(theirs, theirs)]
    scale = np.sqrt(np.diag(covariance))
    if not mine or not np.all(scale > 0):
        raise InputError(f"{path}: its covariance does not contain the parameters to optimise for")
    out = np.zeros((len(target.structure.names),) * 2)
    out[np.ix_(mine, mine)] = np.linalg.inv(covariance / np.outer(scale, scale)) / np.outer(scale, scale)
    return out


def predict_planned(path: str, model: Model) -> Prediction | None:
    """Return the torque along a motion in a YAML, None where the file is none.

    A motion of more joints than the model has must leave the others where the model holds them.
    """
    if Path(path).suffix not in (".yaml", ".yml"):
        return None
    motion = load_motion(path)
    rate = motion.sample_rate if isinstance(motion, Excitation) else _SAMPLE_RATE
    seconds = motion.period if isinstance(motion, Excitation) else motion.duration
    if not seconds * rate <= _MOST_SAMPLES:
        raise InputError(
            f"{path}: a motion of {seconds:.4g} s at {rate:g} Hz is too long: at most {_MOST_SAMPLES / rate:.4g} s"
        )
    if isinstance(motion, Excitation):
        t, state = motion.times(), motion.samples()
    else:
        t = np.arange(0.0, motion.duration, 1.0 / _SAMPLE_RATE)
        state = motion.reference(t)
    missing = [name for name in model.robot.joints if name not in motion.joints]
    if missing:
        raise InputError(f"{path}: joint {missing[0]!r} is missing; the motion has {', '.join(motion.joints)}")
    others = [k for k, name in enumerate(motion.joints) if name not in model.robot.joints]
    if np.any(state.dq[:, others]):
        raise InputError(f"{path}: {motion.joints[others[0]]} moves, which the model holds")
    refuse_elsewhere(model, path, {motion.joints[k]: float(state.q[0, k]) for k in others})
    pick = [motion.joints.index(name) for name in model.robot.joints]
    chosen = Motion(state.q[:, pick], state.dq[:, pick], state.ddq[:, pick], state.dt, state.periodic)
    return predict_motion(model, t, chosen)
