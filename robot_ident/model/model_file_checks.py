"""What can't be right in a `model.yaml` though every field for itself could be: names, units, joints, covariance."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.model.model_schema import ModelFile
from robot_ident.model.structure import Structure
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


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
    """Raise InputError where the matrix can't be a covariance, or is that of other standard deviations."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    if np.any(np.diag(covariance) < 0):
        name = file.parameters[int(np.argmin(np.diag(covariance)))].name
        raise InputError(f"{path}: covariance: the variance of {name} is negative")
    unit = np.outer(scale, scale) + 1e-300
    if np.abs((covariance - covariance.T) / unit).max() > 1e-6:
        raise InputError(f"{path}: covariance is not symmetric")
    if np.abs(covariance / unit).max() > 1.0 + 1e-6:
        raise InputError(f"{path}: covariance holds a correlation above 1")
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
