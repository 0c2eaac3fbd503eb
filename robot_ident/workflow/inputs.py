"""Models and recordings as every command takes them: read once, refused once, processed as the model says."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from robot_ident.bags import read_for
from robot_ident.errors import InputError
from robot_ident.estimation.extend import measured_anew
from robot_ident.estimation.prediction import measured_for
from robot_ident.estimation.validation import residual_on, unusable
from robot_ident.files import refuse_twice
from robot_ident.model.model import Model
from robot_ident.model.model_file import is_model, read_model
from robot_ident.provenance import fingerprint
from robot_ident.recording.checks import refuse_copies, refuse_same_rows
from robot_ident.recording.measurement import Measurement, Source
from robot_ident.recording.recording import Recording
from robot_ident.trajectories.excitation import Excitation


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
        """Return the recordings kept aside as a model of these inputs measures them."""
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


def read_excitations(named: Sequence[str], models: Sequence[Model]) -> list[tuple[str, Excitation]]:
    """Return the excitations that are named; where none is, those that the models say and that are still there."""
    paths = list(named)
    if not paths:
        noted = [model.provenance.get("options", {}).get("trajectory") or () for model in models]
        files = [file for one in noted for file in ([one] if isinstance(one, str) else one)]
        paths = list(dict.fromkeys(str(path) for path in files if Path(str(path)).is_file()))
    return [(path, Excitation.read(path)) for path in paths]
