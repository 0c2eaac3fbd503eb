"""A payload as recordings told it: ten parameters in the last joint's frame, and mass, centre and inertia of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.recording.conditions import KnownPayload, hand
from robot_ident.robot.rigid_body import STANDARD
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array

VAGUE = np.full(10, 200.0)  # kg, kg m, kg m^2: more than any payload, before data
NOTHING = 10.0  # kg, m, kg m^2: a larger standard deviation is no knowledge of what a hand carries
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Where Ixx, Ixy, Iyy, Ixz, Iyz, Izz stand in the matrix."""
_SURE = 1.96  # standard deviations of a 95 % interval
_TOLD = 0.25  # share of what was known before that data must bring the standard deviation below
_CLEARLY = 4.0  # standard deviations


@dataclass(frozen=True)
class Body:
    """A payload: ten parameters [10] about and along the last joint's frame with covariance [10, 10], and what follows.

    centre [3] m in the end effector's frame; inertia (3 x 3) kg m^2 about the centre along its axes; their standard
    deviations by the first order. told [10]: whether the data say anything of a parameter. given: what was known before
    (mass, centre, inertia) and held.
    """

    values: Array
    covariance: Array
    told: tuple[bool, ...]
    centre: Array
    centre_std: Array
    inertia: Array
    inertia_std: Array
    given: tuple[str, ...] = ()

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return float(self.values[0])

    @property
    def mass_std(self) -> float:
        """Standard deviation of the mass [kg]."""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def known(self) -> KnownPayload:
        """The same body as conditions state one."""
        x, y, z = (float(c) for c in self.centre)
        xx, xy, yy, xz, yz, zz = (float(self.inertia[i, j]) for i, j in ENTRIES)
        return KnownPayload(self.mass, (x, y, z), (xx, xy, yy, xz, yz, zz))

    @property
    def in_words(self) -> str:
        """Mass and centre in one line."""
        place = (f"{c:.4f}" if s < NOTHING else "?" for c, s in zip(self.centre, self.centre_std, strict=True))
        mass = f"{self.mass:.4g} kg (given)" if "mass" in self.given else f"{self.mass:.4g} +- {self.mass_std:.2g} kg"
        return f"{mass} at [{', '.join(place)}] m{' (given)' if 'centre' in self.given else ''}"

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know."""
        notes = []
        if self.mass <= 0:
            notes.append("its mass is not positive: does the model hold this payload already?")
        unknown = [name for name, known in zip(STANDARD, self.told, strict=True) if not known]
        if unknown:
            notes.append(f"the motion does not tell {', '.join(unknown)}")
        elif np.linalg.eigvalsh(self.inertia)[0] < -_CLEARLY * float(self.inertia_std.max()):
            notes.append("its inertia about the centre is that of no body: the arm's model may not be this arm's today")
        return tuple(notes)

    def to_dict(self) -> dict[str, Any]:
        """Return mass, centre, inertia and the ten parameters with their uncertainty."""
        std = np.sqrt(np.diag(self.covariance))
        return {
            "mass": self.mass,
            "mass_std": self.mass_std,
            "mass_interval": [self.mass - _SURE * self.mass_std, self.mass + _SURE * self.mass_std],
            "centre": self.centre.tolist(),
            "centre_std": self.centre_std.tolist(),
            "centre_interval": [
                [float(c - _SURE * s), float(c + _SURE * s)] for c, s in zip(self.centre, self.centre_std, strict=True)
            ],
            "inertia": [float(self.inertia[i, j]) for i, j in ENTRIES],
            "inertia_std": [float(self.inertia_std[i, j]) for i, j in ENTRIES],
            "parameters": [
                {"name": name, "value": float(value), "std": float(s), "told": told}
                for name, value, s, told in zip(STANDARD, self.values, std, self.told, strict=True)
            ],
            "given": list(self.given),
        }


def body_of(values: Array, covariance: Array, robot: Robot, given: tuple[str, ...] = ()) -> Body:
    """Return the body of ten parameters [10] with covariance [10, 10] about and along the last joint's frame, of which
    something was `given`.

    With the mass m and first moment m p: centre R' (p - o), inertia R' (I - m (p^2 1 - p p')) R in the hand's frame of
    rotation R and origin o. Raises InputError where the hand isn't on the last link.
    """
    rotation, origin = hand(robot)

    def derived(x: Array) -> Array:
        mass, first = x[0], x[1:4]
        p = first / mass
        about = _symmetric(x[4:]) - mass * (p @ p * np.eye(3) - np.outer(p, p))
        turned = rotation.T @ about @ rotation
        return np.concatenate([rotation.T @ (p - origin), [turned[i, j] for i, j in ENTRIES]])

    slope = np.empty((9, 10))
    sigma = np.sqrt(np.diag(covariance))
    for k in range(10):
        step = np.zeros(10)
        step[k] = 1e-4 * max(float(sigma[k]), 1e-9)
        slope[:, k] = (derived(values + step) - derived(values - step)) / (2.0 * step[k])
    found = derived(values)
    spread = np.sqrt(np.maximum(np.diag(slope @ covariance @ slope.T), 0.0))
    told = tuple(bool(s < _TOLD * v) for s, v in zip(sigma, VAGUE, strict=True))
    spread[:3] *= "centre" not in given
    spread[3:] *= "inertia" not in given
    return Body(values, covariance, told, found[:3], spread[:3], _symmetric(found[3:]), _symmetric(spread[3:]), given)


def _symmetric(six: Sequence[float] | Array) -> Array:
    xx, xy, yy, xz, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
