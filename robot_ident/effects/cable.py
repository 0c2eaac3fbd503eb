"""Cables and hoses that pull."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals
from robot_ident.robot.robot import Robot


class Cable(Effect):
    """A bundle of cables that is bent by the joint: tau = k q + t0, a straight line over position.

    Beside gravity on the same axis, which holds most of a line, k tells how the bundle departs from a sine: one that
    gives way as it is pulled has a negative k there.
    """

    name = "cable"
    equation = "k q + t0"
    meaning = "pull of cables and hoses"
    coefficients = (Coefficient("stiffness", "Nm/rad", "N/m"), Coefficient("offset", "Nm", "N"))
    symmetry = "conservative"
    over_position = True
    signature = "static in position, a straight line"
    confused_with = ("gravity_spring", "base_tilt", "end_stop", "encoder_eccentricity", "torque_offset")
    experiment = "a slow sweep over the whole range of the joint"
    magnitude = "3-20 / 0.2-2 Nm/rad"
    contains = {"torque_offset": "offset"}

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Sit on a joint whose position has limits."""
        return cls.no_end(robot, joint)

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return q and 1."""
        q = x.q[self.joint]
        return [{self.joint: q}, {self.joint: 1.0 + 0.0 * q}]
