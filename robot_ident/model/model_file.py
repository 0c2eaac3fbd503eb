"""`model.yaml`: written for people, read back to the last digit, sufficient by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robot_ident.configuration import read, to_yaml
from robot_ident.errors import InputError
from robot_ident.files import is_special, write_text
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.model_file_checks import check_covariance, check_joints, check_parameters
from robot_ident.model.model_schema import ModelFile
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.load import robot_of
from robot_ident.robot.robot import Definition, Robot

_SCHEMA = tuple(f"\nschema: {quote}robot_ident/model/" for quote in ("", "'", '"'))
_ROUNDING = 1e-9  # by which a bound may be passed in writing and reading
_HEAD = 4_000_000  # characters in which a model says what it is


def is_model(path: Path | str) -> bool:
    """Tell a model from a recording by its content."""
    if is_special(path):
        return False
    try:
        with open(path, encoding="utf-8") as file:
            head = "\n" + file.read(_HEAD)
    except (OSError, UnicodeDecodeError):
        return False
    return any(schema in head for schema in _SCHEMA)


def write_model(model: Model, path: Path | str, *, force: bool = False) -> None:
    """Write `model.yaml`, whole or not at all."""
    write_text(path, to_yaml(model.to_dict()), force=force)


def read_model(path: Path | str) -> Model:
    """Read a `model.yaml`; InputError names the field that can't be used."""
    file = read(ModelFile, path)
    robot = _robot(file, path)
    structure = _structure(file, robot, path)
    p = len(structure.parameters) + len(structure.inner)
    covariance = np.array(file.covariance) if all(len(row) == p for row in file.covariance) else np.empty(0)
    if covariance.shape != (p, p):
        raise InputError(f"{path}: covariance must be {p} x {p}, one row a parameter")
    check_parameters(file, structure, path)
    check_covariance(covariance, file, path)
    check_joints(file, robot, path)
    return Model(
        structure=structure,
        values=np.array([parameter.value for parameter in file.parameters]),
        covariance=covariance,
        estimator=file.estimator,
        noise=NoiseLevel(
            tuple(file.noise.torque_variance),
            tuple(file.noise.position_variance),
            file.noise.periods,
            file.noise.samples_per_period,
        ),
        residual={joint: Fit(**fit.model_dump()) for joint, fit in file.residual.items()},
        condition_number=file.condition_number,
        log10_det_covariance=file.log10_det_covariance,
        processing=file.processing.model_dump(),
        provenance=file.provenance,
        notes=tuple(file.notes),
        per_period=tuple(file.per_period),
        chi_square=file.chi_square,
        dof=file.dof,
        physical=None if file.physical is None else file.physical.model_dump(),
        recordings=tuple(one.model_dump(mode="json") for one in file.recordings),
        gains=None if file.gains is None else tuple(gain.model_dump() for gain in file.gains),
        days=file.days,
        base=file.base,
        payloads=tuple(one.model_dump(mode="json") for one in file.payloads),
    )


def _robot(file: ModelFile, path: Path | str) -> Robot:
    if file.robot_definition is None:
        return load_robot(file.robot)
    return robot_of(Definition(file.robot_definition.yaml, file.robot_definition.urdf), str(path))


def _structure(file: ModelFile, robot: Robot, path: Path | str) -> Structure:
    own = Structure.build(robot)
    try:
        structure = own.with_further([label for label in file.effects if label not in own.labels])
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    names = [parameter.name for parameter in file.parameters]
    expected = [parameter.name for parameter in (*structure.parameters, *structure.inner)]
    if expected != names:
        differ = next((a for a, b in zip(names, expected, strict=False) if a != b), "their number")
        raise InputError(f"{path}: its parameters are not those of robot {robot.name} (first difference: {differ})")
    values = [parameter.value for parameter in file.parameters[len(structure.parameters) :]]
    inner = [i for effect in structure.effects for i in effect.inner]
    for name, one, value in zip(names[len(structure.parameters) :], inner, values, strict=True):
        if not one.lower - _ROUNDING <= value <= one.upper + _ROUNDING:
            raise InputError(f"{path}: {name} = {value:g} lies outside [{one.lower:g}, {one.upper:g}]")
    return structure.with_settings(values)
