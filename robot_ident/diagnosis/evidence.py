"""The measurements as a judge sees them: torque and columns in units of the noise, trajectory by trajectory."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.motion import Array, Mask, Motion
from robot_ident.recording.measurement import Measurement


@dataclass(frozen=True)
class Trajectory:
    """One trajectory: its averaged motion, torque over noise y [N, n] and weight [N, n] (1 / sigma, 0 where a row is
    not used).

    dof [n]: independent rows of each joint. measured: where it comes from.
    """

    measured: Measurement
    motion: Motion
    weight: Array
    y: Array
    dof: Array

    def weighed(self, columns: Array) -> Array:
        """Return columns [N, n, k] (Nm) low-passed as the torque is, and in units of the noise."""
        return self.measured.passed(columns) * self.weight[:, :, None]


@dataclass(frozen=True)
class Evidence:
    """Trajectories with the columns of a model on them; `phi` [N, n, p] and `rigid` for each trajectory.

    memory: what was computed on these trajectories and does not depend on the model, shared by all evidence on them.
    """

    structure: Structure
    trajectories: tuple[Trajectory, ...]
    rigid: tuple[Array, ...]
    phi: tuple[Array, ...]
    values: Array
    memory: dict[Hashable, object] = field(default_factory=dict, compare=False, repr=False)

    @property
    def residual(self) -> tuple[Array, ...]:
        """Weighed residual [N, n] of each trajectory."""
        return tuple(t.y - phi @ self.values for t, phi in zip(self.trajectories, self.phi, strict=True))


def trajectory(measured: Measurement) -> Trajectory:
    """Return a measurement in units of its noise; InputError where the noise is unknown."""
    variance = measured.averaged_variance
    if not np.all(np.isfinite(variance)) or np.any(variance <= 0):
        raise InputError(
            f"{measured.source}: its noise is unknown without periods;"
            " record at least 2 (better 8 or more) periods of a motion"
        )
    used: Mask = measured.used[measured.rows]
    # rows that a low pass has smeared share their noise: their weight in chi-square is that of the independent ones
    weight = used.astype(float) * np.sqrt(measured.independent / variance)
    y = measured.passed(measured.torque) * weight
    return Trajectory(measured, measured.motion, weight, y, used.sum(axis=0) * measured.independent)


def gather(measurements: Sequence[Measurement], structure: Structure) -> Evidence:
    """Return the evidence on a model with its linear parameters fitted to all trajectories."""
    trajectories = tuple(trajectory(measured) for measured in measurements)
    rigid = tuple(structure.rigid_columns(t.motion) for t in trajectories)
    return fitted(structure, trajectories, rigid)


def fitted(
    structure: Structure,
    trajectories: tuple[Trajectory, ...],
    rigid: tuple[Array, ...],
    memory: dict[Hashable, object] | None = None,
) -> Evidence:
    """Return the evidence with the linear parameters fitted; columns that depend on torque are iterated."""
    values = np.zeros(len(structure.names))
    for _ in range(3 if structure.uses_torque else 1):
        phi = tuple(t.weighed(structure.columns(t.motion, values, r)) for t, r in zip(trajectories, rigid, strict=True))
        stacked = np.concatenate([p.reshape(-1, p.shape[2]) for p in phi])
        y = np.concatenate([t.y.ravel() for t in trajectories])
        scale = np.linalg.norm(stacked, axis=0)
        scale[scale == 0.0] = 1.0
        values = np.linalg.lstsq(stacked / scale, y, rcond=1e-10)[0] / scale
    return Evidence(structure, trajectories, rigid, phi, values, {} if memory is None else memory)
