"""An excitation: a Fourier series for a robot's joints, with what it was designed for; what motions offer to others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import Field, field_validator

from robot_ident.configuration import Closed, read, schema, to_yaml
from robot_ident.errors import InputError
from robot_ident.files import write_text
from robot_ident.robot.robot import Robot
from robot_ident.robot.robot_file import builtin_robots
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.fourier_series import FourierSeries, MotionExtremes

SCHEMA = "robot_ident/excitation/1"
_MOST_SAMPLES = 1e7  # a period
_FREQUENCIES = (1e-6, 1e6)  # Hz; periods of weeks, and samples of microseconds
_MOST_HARMONICS = 1000  # whose certificate takes 400 MB and minutes; memory grows with their square
Positive = Annotated[float, Field(gt=0)]


@dataclass(frozen=True)
class Excitation:
    """A periodic trajectory of named joints, sampled at a rate [Hz] that fits its period.

    `criterion`, `achieved`, `limits` and `reproduce` say how it came about. Raises InputError when the samples don't
    fit.
    """

    robot: str
    joints: tuple[str, ...]
    series: FourierSeries
    sample_rate: float
    criterion: str | None = None
    achieved: Mapping[str, Any] = field(default_factory=dict)
    limits: Mapping[str, Any] = field(default_factory=dict)
    reproduce: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the sampling and the number of joints."""
        if len(self.joints) != self.series.joints:
            raise InputError(f"{len(self.joints)} joints are named, but the series moves {self.series.joints}")
        check_sampling(self.series.base_frequency, self.sample_rate, self.series.harmonics)

    @property
    def base_frequency(self) -> float:
        """Base frequency [Hz]."""
        return self.series.base_frequency

    @property
    def period(self) -> float:
        """Period [s]."""
        return self.series.period

    @property
    def harmonics(self) -> int:
        """Number of harmonics."""
        return self.series.harmonics

    @property
    def samples_per_period(self) -> int:
        """Number of samples in a period."""
        return round(self.sample_rate / self.series.base_frequency)

    def times(self) -> Array:
        """Return the instants of one period's samples [N] s."""
        return np.arange(self.samples_per_period) / self.sample_rate

    def samples(self) -> Motion:
        """Return the motion at the samples of one period."""
        motion = self.series.motion(self.times())
        return Motion(motion.q, motion.dq, motion.ddq, dt=1.0 / self.sample_rate, periodic=True)

    def check_robot(self, robot: Robot) -> None:
        """Raise InputError when it is for another robot; those of the package with the same joints share motions."""
        shared = robot.definition is None and self.robot in builtin_robots()
        if self.joints != robot.joints or not (self.robot == robot.name or shared):
            raise InputError(
                f"trajectory of another robot: it is for {self.robot!r} with joints {', '.join(self.joints)};"
                f" robot {robot.name!r} has {', '.join(robot.joints)}: name the file of the one it is for (--robot)"
            )

    def write(self, path: Path | str, *, force: bool = False) -> None:
        """Write `excitation.yaml`, whole or not at all; numbers are exact."""
        write_text(path, to_yaml(self.to_dict()), force=force)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `excitation.yaml`."""
        data: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.joints),
            "base_frequency": float(self.series.base_frequency),
            "sample_rate": float(self.sample_rate),
            "harmonics": self.harmonics,
            "q0": self.series.q0.tolist(),
            "a": self.series.a.tolist(),
            "b": self.series.b.tolist(),
        }
        if self.criterion is not None:
            data["criterion"] = self.criterion
        for key in ("achieved", "limits", "reproduce"):
            if getattr(self, key):
                data[key] = dict(getattr(self, key))
        return data

    @classmethod
    def read(cls, path: Path | str) -> Excitation:
        """Read `excitation.yaml`; InputError lists every problem with its field and value."""
        file = read(ExcitationFile, path)
        if problems := file.problems():
            raise InputError(f"{path}: {'; '.join(problems)}")
        return cls(
            robot=file.robot,
            joints=tuple(file.joints),
            series=FourierSeries(file.base_frequency, np.array(file.q0), np.array(file.a), np.array(file.b)),
            sample_rate=file.sample_rate,
            criterion=file.criterion,
            achieved=file.achieved,
            limits=file.limits,
            reproduce=file.reproduce,
        )


class ExcitationFile(Closed):
    """`excitation.yaml`: the coefficients of eq. (11) and where they come from."""

    schema_: schema(SCHEMA) = Field(alias="schema", description="what this file is")  # type: ignore[valid-type]
    robot: str = Field(description="name of the robot that it was made for")
    joints: list[str] = Field(min_length=1, description="joints that move, in the order of the chain")
    base_frequency: Positive = Field(description="one over the period, Hz")
    sample_rate: Positive = Field(description="samples per second, a whole number of them a period, Hz")
    harmonics: int = Field(ge=1, description="number of terms of the Fourier series")
    q0: list[float] = Field(description="offset of the position by joint, rad")
    a: list[list[float]] = Field(description="cosine coefficients of the velocity by joint and harmonic, rad/s")
    b: list[list[float]] = Field(description="sine coefficients of the velocity by joint and harmonic, rad/s")
    criterion: str | None = Field(None, description="what it was optimised for")
    achieved: dict[str, Any] = Field({}, description="what it reaches: determinant, condition number, for which model")
    limits: dict[str, Any] = Field({}, description="the limits that it was designed and certified for")
    reproduce: dict[str, Any] = Field({}, description="the options of the design that gave it")

    @field_validator("joints")
    @classmethod
    def _distinct(cls, value: list[str]) -> list[str]:
        if len(set(value)) < len(value):
            raise ValueError("every joint may be named once")
        return value

    def problems(self) -> list[str]:
        """Return in words what doesn't agree between the fields."""
        joints, out = len(self.joints), []
        if len(self.q0) != joints:
            out.append(f"q0 has {len(self.q0)} numbers for {joints} joints")
        for name in ("a", "b"):
            rows = getattr(self, name)
            if len(rows) != joints:
                out.append(f"{name} has {len(rows)} rows for {joints} joints")
            out += [
                f"{name} of {joint} has {len(row)} numbers for {self.harmonics} harmonics"
                for joint, row in zip(self.joints, rows, strict=False)
                if len(row) != self.harmonics
            ]
        try:
            check_sampling(self.base_frequency, self.sample_rate, self.harmonics)
        except InputError as error:
            out.append(str(error))
        return out


def check_sampling(base_frequency: float, sample_rate: float, harmonics: int) -> None:
    """Raise InputError unless a period has a whole number of samples that carries the harmonics (Nyquist)."""
    for name, value in (("base_frequency", base_frequency), ("sample_rate", sample_rate)):
        if not 0.0 < value < float("inf"):
            raise InputError(f"{name} = {value:g}: must be above 0 and finite")
        if not _FREQUENCIES[0] <= value <= _FREQUENCIES[1]:
            raise InputError(f"{name} = {value:g} Hz: must be from {_FREQUENCIES[0]:g} to {_FREQUENCIES[1]:g} Hz")
    if harmonics > _MOST_HARMONICS:
        raise InputError(f"{harmonics} harmonics are too many (at most {_MOST_HARMONICS}); raise the base frequency")
    samples = sample_rate / base_frequency
    if samples > _MOST_SAMPLES:
        raise InputError(f"a period of {samples:.3g} samples is too long (at most {_MOST_SAMPLES:.0e})")
    if abs(samples - round(samples)) > 1e-9 or round(samples) < 1:
        raise InputError(
            f"sample_rate {sample_rate:g} Hz over base_frequency {base_frequency:g} Hz gives {samples:.10g} samples"
            " a period; it must be a whole number"
        )
    if 2 * harmonics >= round(samples):
        raise InputError(
            f"{harmonics} harmonics of {base_frequency:g} Hz need a sample rate above"
            f" {2 * harmonics * base_frequency:g} Hz, not {sample_rate:g} Hz"
        )


class Reference(Protocol):
    """A motion from rest to rest that a robot can be made to follow."""

    @property
    def duration(self) -> float:
        """Duration [s]."""

    @property
    def start_pose(self) -> Array:
        """Position at the start [n] rad."""

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s; at rest before the start and after the end."""


@dataclass(frozen=True)
class Piece:
    """A stretch of a motion from `start` to `end` [s] along which q and dq have no jump, with bounds of q, dq and ddq
    on it.

    jerk [n]: bounds of |d^3 q / dt^3| apart from the instants `jumps` at which the acceleration jumps; None where it is
    not known. name: which part of a motion it is.
    """

    start: float
    end: float
    motion: Callable[[Array], Motion]
    extremes: MotionExtremes
    jerk: Array | None = None
    jumps: tuple[float, ...] = ()
    name: str = ""


class Certifiable(Protocol):
    """A motion whose limits can be certified: named joints and pieces with known extremes."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints [n]."""

    def pieces(self) -> Sequence[Piece]:
        """Return the pieces that hold every state of the motion."""
