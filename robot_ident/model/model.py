"""An identified model: parameters with their covariance, and all that is needed to judge and to use it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from robot_ident.model.structure import Parameter, Structure
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion, frozen_array

_POOR = 0.5  # of a joint's torque, in rms: a model that misses more is none of that joint
IMPOSSIBLE = "no arm of this size has"
"""What the note on base parameters begins with whose torque is many times that of a joint."""
_NOT_USABLE = "not usable: "
_TWICE = 2.0  # times the error of filters chosen by prediction: what others must not make of it
_ABOVE_NOISE = 4.0  # times the noise's variance: what a torque is at least to tell anything


@dataclass(frozen=True)
class Fit:
    """How well a model follows one joint: mean square of the residual, its root, the variance of the data's noise,
    relative error.

    mse, noise_variance in (Nm)^2, of the same (averaged, low-passed) data; noise_variance None where unknown.
    relative: the norm of the residual over that of the torque, None where there is no torque.
    """

    mse: float
    rms: float
    noise_variance: float | None
    relative: float | None


def is_poor(error: float, torque: float, noise: float | None) -> bool:
    """Return whether an error is more than half (rms) of a torque that stands above its noise; mean squares, Nm^2."""
    return error > _POOR**2 * torque > 0.0 and (noise is None or torque > _ABOVE_NOISE * noise)


@dataclass(frozen=True)
class NoiseLevel:
    """Noise of the data: variance [n] of one sample of torque and position (None where unknown), M periods of N
    samples.
    """

    torque_variance: tuple[float | None, ...]
    position_variance: tuple[float | None, ...]
    periods: int
    samples_per_period: int


@dataclass(frozen=True)
class Model:
    """tau = Phi(q, dq, ddq) theta with estimates [p + r] of theta and of r inner parameters, and their covariance.

    estimator: ls, wls, ml or iv. processing: how the recordings were processed, as a plain mapping. residual: by joint.
    provenance: recordings with their hashes, versions, date. notes: what was said on the way. per_period: estimates of
    the single periods of each recording, their scatter and drift. chi_square, dof: weighted squared error of the fit
    and its degrees of freedom, None where the noise is unknown. physical: how a physically consistent set was reached
    and the standard inertias that give it, None where none was asked for. gains: of drives, as the recordings told
    them, None where the robot's files know them. days: how estimates of single days scatter. payloads: those that the
    recordings carried and that were found with the arm; the model is that of the arm alone. base: how its processing
    and its offsets and rotor inertias were chosen, None where they were declared. covariance counts what the model
    lacks; noise_covariance does not, None where it is the same.
    """

    structure: Structure
    values: Array
    covariance: Array
    estimator: str
    noise: NoiseLevel
    residual: Mapping[str, Fit]
    condition_number: float
    log10_det_covariance: float
    processing: Mapping[str, Any] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    per_period: tuple[Mapping[str, Any], ...] = ()
    chi_square: float | None = None
    dof: float | None = None
    physical: Mapping[str, Any] | None = None
    recordings: tuple[Mapping[str, Any], ...] = ()
    gains: tuple[Mapping[str, Any], ...] | None = None
    days: Mapping[str, Any] | None = None
    payloads: tuple[Mapping[str, Any], ...] = ()
    base: Mapping[str, Any] | None = None
    noise_covariance: Array | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes."""
        p = len(self.parameters)
        object.__setattr__(self, "values", frozen_array(self.values, p))
        object.__setattr__(self, "covariance", frozen_array(self.covariance, p, p))
        if self.noise_covariance is not None:
            object.__setattr__(self, "noise_covariance", frozen_array(self.noise_covariance, p, p))

    @classmethod
    def read(cls, path: Path | str) -> Model:
        """Read a `model.yaml`."""
        from robot_ident.model.model_file import read_model

        return read_model(path)

    def write(self, path: Path | str, *, force: bool = False) -> None:
        """Write `model.yaml`, whole or not at all."""
        from robot_ident.model.model_file import write_model

        write_model(self, path, force=force)

    @property
    def robot(self) -> Robot:
        """The robot that it models."""
        return self.structure.robot

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters [p + r]: those that the torque is linear in, then the inner ones."""
        return (*self.structure.parameters, *self.structure.inner)

    @property
    def linear(self) -> Array:
        """Values of the parameters that the torque is linear in [p]."""
        return self.values[: len(self.structure.parameters)]

    @property
    def std(self) -> Array:
        """Standard deviation of every parameter [p]: the root of the covariance's diagonal (eq. 9)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def by_noise(self) -> Array:
        """Covariance [p + r, p + r] by noise alone: what it lets a model of these columns leave of other recordings."""
        return self.covariance if self.noise_covariance is None else self.noise_covariance

    @property
    def at_bound(self) -> tuple[bool, ...]:
        """Which parameters [p + r] rest at a bound of theirs, where no standard deviation tells what the data allow."""
        inner = [i.at_bound(effect.setting[i.name]) for effect in self.structure.effects for i in effect.inner]
        return (*(False for _ in self.structure.parameters), *inner)

    @property
    def physical_inertias(self) -> Array | None:
        """Standard parameters of the links [10 n] that give this model, in Pinocchio's order; None unless it was made
        physically consistent.
        """
        if self.physical is None:
            return None
        links = self.physical["inertias"]
        return np.array([links[joint][name] for joint in self.robot.joints for name in STANDARD])

    @property
    def physical_rotors(self) -> Array | None:
        """Rotor inertias [n] kg m^2 that go with `physical_inertias`, None without."""
        if self.physical is None:
            return None
        return np.array([self.physical["rotor_inertia"][joint] for joint in self.robot.joints])

    @property
    def filters_doubt(self) -> str:
        """A line on filters that were asked for, where those chosen by prediction do better; empty where not."""
        base = self.base or {}
        free = base.get("without_asked_filters")
        if not free:
            return ""
        low, wide = free["low_pass"], free["derivative_bandwidth"]
        way = f"low pass {low:.3g} Hz" if low else "periods averaged"
        way += f", positions differentiated to {wide:.3g} Hz" if wide else ""
        return (
            f"with the filters that were asked for the model errs by {100 * base['error']:.3g} % on motion left out,"
            f" with those chosen by prediction by {100 * free['error']:.3g} % ({way}); inertias hang on them: leave"
            " --low-pass and --derivative-bandwidth out"
        )

    @property
    def trouble(self) -> str | None:
        """A line that names the joints at which the model misses more than half of the torque of its own recordings,
        those left out whose torque is hardly more than noise; or the filters that were asked for, where it errs twice
        as much as by those chosen by prediction; or base parameters that no arm can have; None where there is neither.
        """
        base = self.base or {}
        free = base.get("without_asked_filters")
        if free and base["error"] > _TWICE * free["error"]:
            return f"{_NOT_USABLE}{self.filters_doubt}"
        poor = [
            f"{joint} {100 * one.relative:.0f} %"
            for joint, one in self.residual.items()
            if one.relative and is_poor(one.mse, one.mse / one.relative**2, one.noise_variance)
        ]
        if not poor:
            absurd = next((note for note in self.notes if IMPOSSIBLE in note), None)
            return absurd and f"{_NOT_USABLE}{absurd.removeprefix(_NOT_USABLE)}"
        return (
            f"{_NOT_USABLE}on the recordings that it was fitted to the model misses more than half of the torque of"
            f" {', '.join(poor)}; robot_ident info BAG --robot says whether the effort's unit, sign and axis are as"
            " declared, compare where the model fails"
        )

    def leading(self, notes: Iterable[str] = ()) -> tuple[str, ...]:
        """Return the notes of a command on this model, each once, before them that it can't be used (`trouble`), if so:
        every command tells its notes by this.
        """
        first = self.trouble or ""
        return tuple(dict.fromkeys(filter(None, (first, *(line for line in notes if line not in first)))))

    def predict(self, motion: Motion) -> Array:
        """Return the model's torque [N, n] Nm along a motion."""
        tau: Array = self.structure.columns(motion, self.linear) @ self.linear
        return tau

    def _repr_html_(self) -> str:
        """Show the parameters with their uncertainty, and the residual beside the noise, in a notebook."""
        from robot_ident.markup import listed, paragraph, table

        parameters = [
            (p.name, float(value), float(std), p.unit, p.meaning)
            for p, value, std in zip(self.parameters, self.values, self.std, strict=True)
        ]
        fits = [
            (
                joint,
                fit.rms,
                None if fit.noise_variance is None else fit.noise_variance**0.5,
                self.robot.torque_unit(self.robot.joint_index(joint)),
            )
            for joint, fit in self.residual.items()
        ]
        told = f"{self.robot.name}: {len(parameters)} parameters by {self.estimator}"
        return "".join(
            (
                paragraph(f"{told}, condition number {self.condition_number:.4g}"),
                table(("joint", "residual rms", "noise rms", "unit"), fits),
                table(("parameter", "value", "sigma", "unit", "meaning"), parameters),
                listed(self.notes),
            )
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the contents of `model.yaml`, the same as `identify --json` prints."""
        listed = [
            {
                "name": parameter.name,
                "value": float(value),
                "std": None if at_bound else float(std),
                "unit": parameter.unit,
                "joint": parameter.joint,
                "effect": parameter.effect,
                "meaning": parameter.meaning,
                "at_bound": at_bound,
            }
            for parameter, value, std, at_bound in zip(
                self.parameters, self.values, self.std, self.at_bound, strict=True
            )
        ]
        definition = self.robot.definition
        return {
            "schema": "robot_ident/model/1",
            "robot": self.robot.name,
            "estimator": self.estimator,
            "effects": list(self.structure.labels),
            "parameters": listed,
            "noise": {
                "torque_variance": list(self.noise.torque_variance),
                "position_variance": list(self.noise.position_variance),
                "periods": self.noise.periods,
                "samples_per_period": self.noise.samples_per_period,
            },
            "residual": {joint: asdict(fit) for joint, fit in self.residual.items()},
            "condition_number": self.condition_number,
            "log10_det_covariance": self.log10_det_covariance,
            "chi_square": self.chi_square,
            "dof": self.dof,
            "per_period": [dict(one) for one in self.per_period],
            "physical": None if self.physical is None else dict(self.physical),
            "gains": None if self.gains is None else [dict(one) for one in self.gains],
            "days": None if self.days is None else dict(self.days),
            "payloads": [dict(one) for one in self.payloads],
            "base": None if self.base is None else dict(self.base),
            "recordings": [dict(one) for one in self.recordings],
            "processing": dict(self.processing),
            "provenance": dict(self.provenance),
            "notes": list(self.notes),
            "covariance": self.covariance.tolist(),
            "noise_covariance": None if self.noise_covariance is None else self.noise_covariance.tolist(),
            "robot_definition": None
            if definition is None
            else {"yaml": dict(definition.yaml), "urdf": definition.urdf},
        }
