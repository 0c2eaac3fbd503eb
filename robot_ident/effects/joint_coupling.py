"""Friction and inertia through another joint's drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Inner, Mathematics, Signals
from robot_ident.robot.robot import Robot


class JointCoupling(Effect):
    """A drive train that turns with another joint too (a wrist's shafts, a parallel linkage): tau = b dq_o + c
    sign(dq_o) + I ddq_o, o the other joint, counted from 1.
    """

    name = "joint_coupling"
    equation = "b dq_o + c sign(dq_o) + I ddq_o, o = other joint (1 = first)"
    meaning = "friction and inertia over another joint's motion"
    coefficients = (
        Coefficient("viscous", "Nm s/rad", "N s/rad"),
        Coefficient("coulomb", "Nm", "N"),
        Coefficient("inertia", "kg m^2", "kg m", symmetry="conservative"),
    )
    inner = (Inner("other", "", "", 1.0, 7.0, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), continuous=False),)
    symmetry = "dissipative"
    signature = "over another joint's velocity"
    confused_with = ("wrist_coupling", "coulomb", "viscous", "rotor_inertia")
    experiment = "move one joint at a time, the other at rest"
    magnitude = "6-40 % of Coulomb friction / the same"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Have another joint."""
        return "there is no other joint" if robot.n < 2 else None

    def placed_inner(self) -> tuple[Inner, ...]:
        """Search all other joints."""
        others = tuple(float(k + 1) for k in range(self.robot.n) if k != self.joint)
        return (replace(self.inner[0], grid=others, upper=float(self.robot.n)),)

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return dq, sign(dq) and ddq of the other joint."""
        o = int(self.setting["other"]) - 1
        return [{self.joint: x.dq[o]}, {self.joint: m.sign(x.dq[o])}, {self.joint: x.ddq[o]}]
