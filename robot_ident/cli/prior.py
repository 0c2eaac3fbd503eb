"""What earlier recordings or models tell already, for a design that goes on from there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array

if TYPE_CHECKING:
    from robot_ident.design.target import Target
    from robot_ident.model.model import Model


def prior_information(words: Sequence[str], target: Target, model: Model | None, *, bound: bool) -> Array | None:
    """Return the information [p, p] of recordings and models about a target's parameters, None where none are given.

    Recordings are processed as the model says (as usual without one). A model counts by the inverse of its covariance.
    """
    if not words:
        return None
    from robot_ident.model.model_file import is_model

    size = len(target.structure.parameters)
    out = np.zeros((size, size))
    bags = [word for word in words if not is_model(word)]
    for word in words:
        if word not in bags:
            out += _of_model(word, target)
    return out + _of_recordings(bags, target, model, bound) if bags else out


def _of_recordings(bags: Sequence[str], target: Target, model: Model | None, bound: bool) -> Array:
    from robot_ident.bags import read_for
    from robot_ident.estimation.information import information
    from robot_ident.files import refuse_twice
    from robot_ident.recording.checks import refuse_copies
    from robot_ident.recording.measurement import Processing
    from robot_ident.recording.process import process

    refuse_twice(bags)
    processing = Processing(**dict(model.processing)) if model and model.processing else Processing()
    measurements = [process(read_for(bag, target.robot), target.robot, processing) for bag in bags]
    refuse_copies(measurements)
    return information(measurements, target.structure, target.values, bound=bound)


def _of_model(path: str, target: Target) -> Array:
    """Return the information of a model about the parameters that it shares with the target, the others set free."""
    from robot_ident.model.model_file import read_model

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
