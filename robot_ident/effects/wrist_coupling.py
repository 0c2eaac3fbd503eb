"""A motor whose shaft turns with two joints, as in the wrists of many industrial arms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from robot_ident.effects.effect import DRIVE_SIDE, Coefficient, Effect, Mathematics, Signals
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
        Coefficient("inertia", "kg m^2", "kg", symmetry="conservative"),
        Coefficient("viscous", "Nm s/rad", "N s/m"),
        Coefficient("coulomb", "Nm", "N"),
    )
    symmetry = "dissipative"
    signature = "over the velocity of two joints"
    confused_with = ("joint_coupling",)
    experiment = "move one of the two joints at a time: a shared motor acts on the one that stands still"
    magnitude = "as the joint's own friction and rotor inertia / the same"
    seen_from = DRIVE_SIDE
    before_sensor = "the shared motor stands before the sensors of both joints"
    candidate = False  # joint_coupling finds it; that one motor is behind it says the maker's drawing

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Couple a joint with the one before it: there is none before the first."""
        return "there is no joint before it to be coupled with" if joint == 0 else None

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return the three columns on both joints."""
        i, j = self.joint - 1, self.joint
        s = m.sign(x.dq[i] + x.dq[j])
        return [{i: x.ddq[j], j: x.ddq[i]}, {i: x.dq[j], j: x.dq[i]}, {i: s, j: s}]
