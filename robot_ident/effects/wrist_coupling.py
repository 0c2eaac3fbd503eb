"""A motor whose shaft turns with two joints, as in the wrists of many industrial arms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals
from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot


class WristCoupling(Effect):
    """Motor j turns with dq_j + dq_i, i the joint before it: its inertia and friction load both.

    tau_i += I ddq_j + b dq_j + c sign(dq_i + dq_j), tau_j += I ddq_i + b dq_i + c sign(dq_i + dq_j). The parts of I
    and b on a joint's own motion merge with its own rotor inertia and viscous friction (Gautier, Staubli TX and RX
    wrists).
    """

    name = "wrist_coupling"
    equation = "I ddq_other + b dq_other + c sign(dq_i + dq_j), on joints i = j - 1 and j"
    meaning = "a motor that turns with two joints"
    coefficients = (
        Coefficient("inertia", "kg m^2", "kg"),
        Coefficient("viscous", "Nm s/rad", "N s/m"),
        Coefficient("coulomb", "Nm", "N"),
    )
    symmetry = "dissipative"
    signature = "over the velocity of two joints"

    def __init__(self, robot: Robot, joint: int, setting: Mapping[str, float] | None = None) -> None:
        """Couple a joint with the one before it; InputError at the first joint."""
        super().__init__(robot, joint, setting)
        if joint == 0:
            raise InputError(f"{self.label}: there is no joint before it to be coupled with")

    def terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return the three columns on both joints."""
        i, j = self.joint - 1, self.joint
        s = m.sign(x.dq[i] + x.dq[j])
        return [{i: x.ddq[j], j: x.ddq[i]}, {i: x.dq[j], j: x.dq[i]}, {i: s, j: s}]
