"""What compare, diagnose and add share: a model and the recordings that it is held against."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from robot_ident.cli.output import Options, add_json
from robot_ident.errors import InputError

if TYPE_CHECKING:
    from robot_ident.model.model import Model
    from robot_ident.recording.measurement import Measurement


def add_common(parser: Options) -> None:
    """Add the options that the commands with recordings share."""
    add_recordings(parser)
    add_json(parser)


def add_recordings(parser: Options) -> None:
    """Add `--validation` and `--topic`."""
    add_validation(parser)
    parser.add_argument("--topic", metavar="T", help="topic of the joint states")


def add_validation(parser: Options) -> None:
    """Add the recordings of the validation: several after one option, or one after each."""
    parser.add_argument(
        "--validation",
        action="extend",
        nargs="+",
        default=[],
        metavar="BAG2",
        help="validation recordings, never used in a fit",
    )


@dataclass(frozen=True)
class Inputs:
    """Models and measurements; those of `validation` never enter a fit."""

    models: tuple[Model, ...]
    paths: tuple[str, ...]
    bags: tuple[str, ...]
    measurements: tuple[Measurement, ...]
    validation: tuple[Measurement, ...]


def read_inputs(words: Sequence[str], validation: Sequence[str], topic: str | None) -> Inputs:
    """Read models and recordings from one list; recordings are processed as the first model says."""
    from robot_ident.bags import read_for
    from robot_ident.estimation.for_model import measured_for
    from robot_ident.files import refuse_twice
    from robot_ident.model.model_file import is_model, read_model
    from robot_ident.recording.checks import refuse_copies, refuse_same_rows

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
    return Inputs(models, paths, bags, measured, unseen)


def validated_for(model: Model, validation: Sequence[str], topic: str | None) -> tuple[Measurement, ...]:
    """Return recordings kept aside, processed as a model says."""
    return tuple(_measured(model, bag, topic) for bag in validation)


def with_model(inputs: Inputs, model: Model, validation: Sequence[str], topic: str | None) -> Inputs:
    """Return inputs with another model that came from theirs; measured anew where that model measures otherwise."""
    from robot_ident.estimation.gains_anew import measured_anew

    given = replace(inputs, models=(model,))
    if not measured_anew(model):
        return given
    measured = tuple(_measured(model, bag, topic) for bag in inputs.bags)
    return replace(given, measurements=measured, validation=validated_for(model, validation, topic))


def _refuse_fitted(bags: Sequence[str], validation: Sequence[str]) -> None:
    """Raise InputError where a recording is to be fitted and to be unseen."""
    fitted = {os.path.realpath(bag) for bag in bags}
    for bag in validation:
        if os.path.realpath(bag) in fitted:
            raise InputError(f"--validation {bag}: is one of the fitted recordings; give an independent one")


def _refuse_stranger(model: Model, bag: str, measured: Measurement) -> None:
    """Raise InputError for a recording of which the model predicts nothing: joints of other robots have like names."""
    from robot_ident.estimation.unusable import residual_on, unusable

    found = residual_on(model, measured)
    if found and all(one.relative is None or one.relative > 1.0 for one in found.values()):
        raise InputError(
            f"{bag}: a recording of another robot than {model.robot.name}? at every joint the model errs by more than"
            f" the torque itself; if it is of this one: {unusable(model, bag, found) or 'nothing in it moves'}"
        )


def _measured(model: Model, bag: str, topic: str | None) -> Measurement:
    from robot_ident.bags import read_for
    from robot_ident.estimation.for_model import measured_for

    return measured_for(model, read_for(bag, model.robot, topic=topic))
