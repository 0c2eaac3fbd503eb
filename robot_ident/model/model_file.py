"""`model.yaml`: written for people, read back to the last digit, sufficient by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from robot_ident.configuration import Closed, read, schema, to_yaml
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.load import robot_of
from robot_ident.robot.robot import Definition, Robot


class ParameterFile(Closed):
    """A parameter in `model.yaml`."""

    name: str
    value: float
    std: float = Field(ge=0)
    unit: str
    joint: str | None
    effect: str
    meaning: str = ""


class FitFile(Closed):
    """The residual of a joint in `model.yaml`."""

    mse: float
    rms: float
    noise_variance: float | None
    relative: float


class NoiseFile(Closed):
    """The noise in `model.yaml`."""

    torque_variance: list[float | None]
    position_variance: list[float | None]
    periods: int = Field(ge=1)
    samples_per_period: int = Field(ge=1)


class DefinitionFile(Closed):
    """The robot in `model.yaml`, where it doesn't come with the package."""

    yaml: dict[str, Any]
    urdf: str


class ModelFile(Closed):
    """`schema: robot_ident/model/1`."""

    schema_: schema("robot_ident/model/1") = Field(alias="schema")  # type: ignore[valid-type]
    robot: str
    estimator: str
    effects: list[str]
    parameters: list[ParameterFile]
    noise: NoiseFile
    residual: dict[str, FitFile]
    condition_number: float
    log10_det_covariance: float
    chi_square: float | None = None
    dof: float | None = None
    per_period: list[dict[str, Any]] = []
    physical: dict[str, Any] | None = None
    processing: dict[str, Any] = {}
    provenance: dict[str, Any] = {}
    notes: list[str] = []
    covariance: list[list[float]]
    robot_definition: DefinitionFile | None = None


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
        processing=file.processing,
        provenance=file.provenance,
        notes=tuple(file.notes),
        per_period=tuple(file.per_period),
        chi_square=file.chi_square,
        dof=file.dof,
        physical=file.physical,
    )


def _robot(file: ModelFile, path: Path | str) -> Robot:
    if file.robot_definition is None:
        return load_robot(file.robot)
    return robot_of(Definition(file.robot_definition.yaml, file.robot_definition.urdf), str(path))


def _structure(file: ModelFile, robot: Robot, path: Path | str) -> Structure:
    known = Structure.build(robot).labels
    structure = Structure.build(robot, [label for label in file.effects if label not in known])
    names = [parameter.name for parameter in file.parameters]
    expected = [parameter.name for parameter in (*structure.parameters, *structure.inner)]
    if expected != names:
        differ = next((a for a, b in zip(names, expected, strict=False) if a != b), "their number")
        raise InputError(f"{path}: its parameters are not those of robot {robot.name} (first difference: {differ})")
    return structure.with_settings([parameter.value for parameter in file.parameters[len(structure.parameters) :]])
