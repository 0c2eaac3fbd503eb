"""`model.yaml`: written for people, read back to the last digit, sufficient by itself."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from robot_ident.configuration import Closed, read, schema, to_yaml
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.model_file_checks import check_covariance, check_joints, check_parameters
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.load import robot_of
from robot_ident.robot.robot import Definition, Robot

MOST_DECIMATED = 1000
"""Of so many rows one is kept at most: of a minute at 1 kHz 60 are left then."""
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class ParameterFile(Closed):
    """A parameter in `model.yaml`."""

    name: str
    value: float
    std: float | None = Field(ge=0)
    unit: str
    joint: str | None
    effect: str
    meaning: str = ""
    at_bound: bool = False


class FitFile(Closed):
    """The residual of a joint in `model.yaml`."""

    mse: NotNegative
    rms: NotNegative
    noise_variance: NotNegative | None
    relative: NotNegative | None


class NoiseFile(Closed):
    """The noise in `model.yaml`."""

    torque_variance: list[NotNegative | None]
    position_variance: list[NotNegative | None]
    periods: int = Field(ge=1)
    samples_per_period: int = Field(ge=1)


class ProcessingFile(Closed):
    """How recordings were processed, in `model.yaml`; what is left out is as the program has it."""

    base_frequency: Positive | None = None
    periodic: bool | None = None
    low_pass: Positive | None = None
    derivative_bandwidth: Positive | None = None
    decimate: int = Field(1, ge=1, le=MOST_DECIMATED)
    minimum_speed: list[NotNegative] | None = None
    anti_alias: tuple[NotNegative, NotNegative] | None = None


class PhysicalFile(Closed):
    """Physically consistent inertias in `model.yaml`."""

    distance: NotNegative
    residual_rise: float
    violated: list[str]
    covariance: Literal["data", "constrained"]
    inertias: dict[str, dict[str, float]]
    rotor_inertia: dict[str, float]


class GainFile(Closed):
    """The gain of a drive in `model.yaml`, as recordings with and without a known payload told it."""

    joint: str
    value: Positive
    std: NotNegative
    unit: str
    payload_rms: NotNegative
    loaded: bool


class BodyParameterFile(Closed):
    """One of the ten inertial parameters of a payload in `model.yaml`, in the last joint's frame."""

    name: str
    value: float
    std: NotNegative
    told: bool


class PayloadFile(Closed):
    """A payload in `model.yaml` that was found together with the arm."""

    name: str
    recordings: list[str]
    mass: float
    mass_std: NotNegative
    mass_interval: tuple[float, float]
    centre: tuple[float, float, float]
    centre_std: tuple[NotNegative, NotNegative, NotNegative]
    centre_interval: list[tuple[float, float]]
    inertia: Annotated[list[float], Field(min_length=6, max_length=6)]
    inertia_std: Annotated[list[NotNegative], Field(min_length=6, max_length=6)]
    parameters: list[BodyParameterFile]
    given: list[Literal["mass", "centre", "inertia"]] = []
    covariance: list[list[float]]
    notes: list[str] = []


class RecordingFile(Closed):
    """How a recording was taken that a model rests on, in `model.yaml`."""

    source: str
    sample_rate: NotNegative
    clock: dict[str, Any] | None
    taken_as: Literal["periods", "cycles", "one_pass"]
    period: Positive | None
    repeats: int = Field(ge=1)
    reach: dict[str, tuple[float, float, NotNegative]]


class DefinitionFile(Closed):
    """The robot in `model.yaml`, where it doesn't come with the package."""

    yaml: dict[str, Any]
    urdf: str


class ModelFile(Closed):
    """`schema: robot_ident/model/1`."""

    schema_: schema("robot_ident/model/1") = Field(alias="schema")  # type: ignore[valid-type]
    robot: str
    estimator: Literal["ls", "wls", "ml", "iv"]
    effects: list[str]
    parameters: list[ParameterFile]
    noise: NoiseFile
    residual: dict[str, FitFile]
    condition_number: float
    log10_det_covariance: float
    chi_square: NotNegative | None = None
    dof: Positive | None = None
    per_period: list[dict[str, Any]] = []
    physical: PhysicalFile | None = None
    recordings: list[RecordingFile] = Field(min_length=1)
    gains: list[GainFile] | None = None
    days: dict[str, Any] | None = None
    payloads: list[PayloadFile] = []
    processing: ProcessingFile = ProcessingFile()
    provenance: dict[str, Any] = {}
    notes: list[str] = []
    covariance: list[list[float]]
    robot_definition: DefinitionFile | None = None


_SCHEMA = tuple(f"\nschema: {quote}robot_ident/model/" for quote in ("", "'", '"'))
_HEAD = 4_000_000  # characters in which a model says what it is


def is_model(path: Path | str) -> bool:
    """Tell a model from a recording by its content."""
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
        payloads=tuple(one.model_dump(mode="json") for one in file.payloads),
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
