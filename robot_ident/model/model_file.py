"""`model.yaml`: written for people, read back to the last digit, sufficient by itself.

What can't be right in one is refused though every field for itself could be: names, units, joints, covariance.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from robot_ident.configuration import Closed, read, schema, to_yaml
from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import is_special, write_text
from robot_ident.model.model import Fit, Model, NoiseLevel
from robot_ident.model.structure import Structure
from robot_ident.robot import load_robot
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.robot.robot import Definition, Robot
from robot_ident.robot.robot_file import robot_of
from robot_ident.signals.motion import Array

MOST_DECIMATED = 1000
"""Of so many rows one is kept at most: of a minute at 1 kHz 60 are left then."""
HIGHEST_BASE_FREQUENCY = 1e4
"""Hz: no motion repeats as often."""
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

    base_frequency: Annotated[float, Field(gt=0, le=HIGHEST_BASE_FREQUENCY)] | None = None
    periodic: bool | None = None
    low_pass: Positive | None = None
    derivative_bandwidth: Positive | None = None
    velocity_bandwidth: Positive | None = None
    decimate: int = Field(1, ge=1, le=MOST_DECIMATED)
    minimum_speed: list[NotNegative] | None = None
    anti_alias: tuple[NotNegative, NotNegative] | None = None
    band: Positive | None = None
    band_derivative: Positive | None = None


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
    time_scale: Literal["period", "received", "apart"] | None = None
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
    base: dict[str, Any] | None = None
    payloads: list[PayloadFile] = []
    processing: ProcessingFile = ProcessingFile()
    provenance: dict[str, Any] = {}
    notes: list[str] = []
    covariance: list[list[float]]
    noise_covariance: list[list[float]] | None = None
    robot_definition: DefinitionFile | None = None


def check_parameters(file: ModelFile, structure: Structure, path: Path | str) -> None:
    """Raise InputError where a parameter's unit, joint or effect is not that of its name, or no effect is listed."""
    for place, (told, known) in enumerate(zip(file.parameters, (*structure.parameters, *structure.inner), strict=True)):
        for field in ("unit", "joint", "effect"):
            found, expected = getattr(told, field), getattr(known, field)
            if found != expected:
                raise InputError(f"{path}: parameters.{place}.{field} = {found!r}: of {known.name} it is {expected!r}")
    lacking = [label for label in structure.labels if label not in file.effects]
    if lacking:
        raise InputError(f"{path}: effects lacks {', '.join(lacking)}, which its parameters have")


def check_covariance(covariance: Array, file: ModelFile, path: Path | str) -> None:
    """Raise InputError where a covariance is that of other standard deviations."""
    scale = np.sqrt(np.diag(covariance))
    for parameter, own in zip(file.parameters, scale, strict=True):
        if parameter.std is not None and abs(parameter.std - own) > 1e-6 * max(own, parameter.std):
            raise InputError(
                f"{path}: {parameter.name}: std {parameter.std:.6g} is not the root of its variance, {own:.6g}"
            )


def check_joints(file: ModelFile, robot: Robot, path: Path | str) -> None:
    """Raise InputError where what is kept by joint is not of the robot's joints."""
    by_joint: dict[str, Iterable[str]] = {"residual": file.residual}
    if file.physical is not None:
        by_joint |= {"physical.inertias": file.physical.inertias}
        by_joint |= {"physical.rotor_inertia": file.physical.rotor_inertia}
        for joint, ten in file.physical.inertias.items():
            if set(ten) != set(STANDARD):
                raise InputError(f"{path}: physical.inertias.{joint} must hold {', '.join(STANDARD)} and nothing else")
    for field, names in by_joint.items():
        if set(names) != set(robot.joints):
            raise InputError(
                f"{path}: {field} is of {', '.join(names) or 'no joint'}, not of {', '.join(robot.joints)}"
            )
    for field in ("torque_variance", "position_variance"):
        if len(getattr(file.noise, field)) != robot.n:
            raise InputError(f"{path}: noise.{field} must have {robot.n} values, one a joint")
    speeds = file.processing.minimum_speed
    if speeds is not None and len(speeds) != robot.n:
        raise InputError(f"{path}: processing.minimum_speed must have {robot.n} values, one a joint")
    for place, (joint, variance) in enumerate(zip(robot.joints, file.noise.torque_variance, strict=True)):
        if variance == 0.0 and file.residual[joint].relative is not None:
            raise InputError(
                f"{path}: noise.torque_variance.{place} = 0: no torque sensor is without noise; null: unknown"
            )
    for place, one in enumerate(file.recordings):
        for joint, (low, high, _) in one.reach.items():
            if joint not in robot.joints:
                words = did_you_mean(joint, robot.joints)
                raise InputError(f"{path}: recordings.{place}.reach: {joint!r} is no joint of the robot{words}")
            if low > high:
                raise InputError(f"{path}: recordings.{place}.reach.{joint} = [{low:g}, {high:g}, ...]: lowest first")


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


def _covariance(rows: list[list[float]], key: str, file: ModelFile, path: Path | str) -> Array:
    """Return the matrix [p, p] of a key; InputError where it can't be a covariance."""
    p, out = len(file.parameters), np.array(rows) if len({len(row) for row in rows}) == 1 else np.empty(0)
    if out.shape != (p, p):
        raise InputError(f"{path}: {key} must be {p} x {p}, one row a parameter")
    if np.any(np.diag(out) < 0):
        name = file.parameters[int(np.argmin(np.diag(out)))].name
        raise InputError(f"{path}: {key}: the variance of {name} is negative")
    scale = np.sqrt(np.diag(out))
    unit = np.outer(scale, scale) + 1e-300
    if np.abs((out - out.T) / unit).max() > 1e-6:
        raise InputError(f"{path}: {key} is not symmetric")
    if np.abs(out / unit).max() > 1.0 + 1e-6:
        raise InputError(f"{path}: {key} holds a correlation above 1")
    return out


def read_model(path: Path | str) -> Model:
    """Read a `model.yaml`; InputError names the field that can't be used."""
    file = read(ModelFile, path)
    robot = _robot(file, path)
    structure = _structure(file, robot, path)
    check_parameters(file, structure, path)
    covariance, by_noise = _covariance(file.covariance, "covariance", file, path), file.noise_covariance
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
        noise_covariance=None if by_noise is None else _covariance(by_noise, "noise_covariance", file, path),
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
