"""What `model.yaml` holds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from robot_ident.configuration import Closed, schema

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
    robot_definition: DefinitionFile | None = None
