"""What is known of a payload stays what it is while the rest is estimated."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from robot_ident.errors import InputError
from robot_ident.estimation.body import ENTRIES, VAGUE
from robot_ident.recording.conditions import Conditions, PayloadPart, hand
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array


def part_of(stated: Iterable[tuple[str, Conditions]]) -> PayloadPart:
    """Return what the conditions of recordings (source, conditions) say together of a payload that all of them carried.

    Raises InputError where they contradict each other.
    """
    told: dict[str, tuple[str, object]] = {}
    for source, conditions in stated:
        for name in conditions.part.given:
            value = getattr(conditions.part, name)
            first, known = told.setdefault(name, (source, value))
            if known != value:
                raise InputError(
                    f"{source}: payload {conditions.body}: {name} = {value}, where {first} states {known}; one name"
                    " stands for one body"
                )
    return PayloadPart(**{name: value for name, (_, value) in told.items()})  # type: ignore[arg-type]


class Holding:
    """The payloads that have a mass m, a centre c or an inertia J about it that are known, among those of any ten
    parameters (m, f = m c, I = J + S(f) / m) in the last joint's frame, S(f) = f^2 1 - f f'.

    Free are m, f and I where nothing is known of them; f = m c follows the mass where c is known, and I follows both
    where J is.
    """

    def __init__(self, part: PayloadPart, robot: Robot) -> None:
        """Hold `part`; InputError where the hand isn't on the last link."""
        rotation, self._origin = hand(robot)
        self.given = part.given
        self._mass = part.mass
        self._centre = None if part.centre is None else self._origin + rotation @ np.array(part.centre)
        self._inertia = None
        if part.inertia is not None:
            xx, xy, yy, xz, yz, zz = part.inertia
            self._inertia = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T

    @property
    def curved(self) -> bool:
        """Whether what is known bends the space of what is left, so that it takes several steps to be found."""
        return self._inertia is not None and self._centre is None

    def start(self) -> Array:
        """Return the ten parameters [10] to begin with: a known mass where the hand is, else nothing."""
        values = np.zeros(10)
        if self._mass is not None:
            values[0] = self._mass
            values[1:4] = self._mass * self._origin
        return self.settled(values)

    def settled(self, values: Array) -> Array:
        """Return the ten parameters [10] next to others that keep what is known."""
        out = np.array(values)
        if self._mass is not None:
            out[0] = self._mass
        if self._centre is not None:
            out[1:4] = out[0] * self._centre
        if self._inertia is not None and out[0] != 0.0:
            out[4:] = _six(self._inertia + _spread(out[1:4]) / out[0])
        return out

    def directions(self, values: Array) -> tuple[Array, Array]:
        """Return how the ten parameters may change about `values` [10, k], and what is known of each way before data
        [k].
        """
        columns, vague = [], []
        mass, first = self._mass is None, self._centre is None
        place = self._centre if self._centre is not None else values[1:4] / (values[0] or 1.0)
        bound = self._inertia is not None and (self._centre is not None or values[0] != 0.0)
        if mass:
            column = np.zeros(10)
            column[0] = 1.0
            column[1:4] = 0.0 if first else place
            column[4:] = (-1.0 if first else 1.0) * _six(_spread(place)) * bound
            columns.append(column)
            vague.append(VAGUE[0])
        if first:
            for axis in np.eye(3):
                bent = np.outer(axis, place) + np.outer(place, axis)
                columns.append(np.concatenate([[0.0], axis, _six(np.trace(bent) * np.eye(3) - bent) * bound]))
            vague.extend(VAGUE[1:4])
        if not bound:
            columns.extend(np.eye(10)[4:])
            vague.extend(VAGUE[4:])
        return np.array(columns).T, np.array(vague)


def _spread(first: Array) -> Array:
    """Return f^2 1 - f f' [3, 3]."""
    return np.asarray(first @ first * np.eye(3) - np.outer(first, first))


def _six(matrix: Array) -> Array:
    return np.array([matrix[i, j] for i, j in ENTRIES])
