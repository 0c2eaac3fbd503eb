"""What unknown payloads may add to the torque of their recordings, beside what is known of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.estimation.carried import rows_of_payloads
from robot_ident.estimation.equations import Equations
from robot_ident.estimation.held_body import Holding, part_of
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

_DIGITS = 1e-9  # share of the largest singular value below which a motion shows nothing


def open_load(measurements: Sequence[Measurement], equations: Equations, robot: Robot) -> tuple[Array, Array]:
    """Return the torque [R] Nm of what is known of unknown payloads, and a basis [R, k] of what they may add to it.

    A known inertia counts where the centre is known too: about an unknown one it bends that space.
    """
    names = tuple(dict.fromkeys(m.conditions.body for m in measurements if m.conditions.estimated))
    if not names:
        return np.zeros(equations.rows), np.zeros((equations.rows, 0))
    loads = rows_of_payloads(measurements, equations, robot, names)
    torque, ways = np.zeros(equations.rows), []
    for k, name in enumerate(names):
        stated = [
            (m.source, m.conditions) for m in measurements if m.conditions.estimated and m.conditions.body == name
        ]
        part = part_of(stated)
        holding = Holding(part if part.centre else replace(part, inertia=None), robot)
        values, own = holding.start(), loads[:, 10 * k : 10 * k + 10]
        torque += own @ values
        ways.append(basis_of(own @ holding.directions(values)[0])[0])
    return torque, np.hstack(ways)


def basis_of(columns: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis [R, r] of columns [R, k], and the combination of them [k, r] that it is: U = X T."""
    left, size, right = np.linalg.svd(columns, full_matrices=False)
    shown = size > _DIGITS * size[0]
    return np.asarray(left[:, shown]), np.asarray(right[shown].T / size[shown])
