"""The stacked equations F theta = b of one or several measurements (Swevers et al. 1997, eq. 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.model.structure import Structure
from robot_ident.recording.checks import refuse_silent
from robot_ident.recording.measurement import Measurement
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Equations:
    """Rows that count, of all measurements and joints.

    phi [R, p], torque [R] Nm, both averaged and low-passed; joint [R], block [R]: which joint and measurement a row
    belongs to; sample [R]: its place among the (decimated) rows of that measurement; variance [R] (Nm)^2 of its noise,
    nan where unknown; independent [R]: share of independent noise among its neighbours.
    """

    phi: Array
    torque: Array
    joint: np.ndarray
    block: np.ndarray
    sample: np.ndarray
    variance: Array
    independent: Array

    @property
    def rows(self) -> int:
        """Number of rows R."""
        return len(self.torque)


def stack(
    measurements: Sequence[Measurement],
    structure: Structure,
    values: Array | None = None,
    rigid: Sequence[Array] | None = None,
) -> Equations:
    """Return the equations of some measurements; InputError when a joint has too few rows.

    values [p]: where columns depend on the model's torque. rigid: base columns of each measurement, where known
    already.
    """
    refuse_silent(measurements, "; identify the others alone: --joints {moving}")
    source = ", ".join(measured.source for measured in measurements)
    parts: list[list[np.ndarray]] = []
    for block, measured in enumerate(measurements):
        known = None if rigid is None else rigid[block]
        phi = measured.passed(structure.columns(measured.motion, values, known))
        torque = measured.passed(measured.torque)
        used = measured.used[measured.rows]
        variance = measured.averaged_variance
        for joint in range(structure.robot.n):
            rows = used[:, joint]
            count = int(rows.sum())
            parts.append(
                [
                    phi[rows, joint],
                    torque[rows, joint],
                    np.full(count, joint),
                    np.full(count, block),
                    np.flatnonzero(rows),
                    np.full(count, variance[joint]),
                    np.full(count, measured.independent),
                ]
            )
    joined = [np.concatenate(part) for part in zip(*parts, strict=True)]
    phi, torque, joint_of, block_of, sample, variance_of, independent = joined
    if len(torque) <= len(structure.parameters):
        raise InputError(
            f"{source}: {len(torque)} usable samples are too few for {len(structure.parameters)} parameters"
        )
    return Equations(
        phi, torque, joint_of.astype(int), block_of.astype(int), sample.astype(int), variance_of, independent
    )
