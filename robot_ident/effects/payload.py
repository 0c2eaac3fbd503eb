"""What the tool carries."""

from __future__ import annotations

from robot_ident.effects.effect import Coefficient, Effect, Torques
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class Payload(Effect):
    """A mass in the hand: the ten inertial parameters of the last link change by those of the payload (Khalil, Gautier
    and Lemoine 2007).

    The last link's own parameters have the same columns, so that one recording absorbs it altogether; it shows as a
    change of them between recordings with and without.
    """

    name = "payload"
    equation = "Y_last(q, dq, ddq) [m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz]"
    meaning = "inertia of a payload, in the last joint's frame"
    coefficients = (
        Coefficient("m", "kg", "kg", positive=True),
        *(Coefficient(name, "kg m", "kg m") for name in ("mx", "my", "mz")),
        *(Coefficient(name, "kg m^2", "kg m^2") for name in ("Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")),
    )
    symmetry = "conservative"
    signature = "none in one run: the last link's parameters absorb it; they differ between runs"
    experiment = "identify with and without the payload and compare the last link's parameters"
    magnitude = "any, up to the robot's rated load"
    scope = "robot"
    symbolic = False
    regression = False
    measuring = True
    evidence = "the last link's parameters differ between two recordings by more than their uncertainty"

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Not a part of one model."""
        return (
            "invisible in one run, the last link's parameters absorb it; identify with and without it and compare"
            " those parameters"
        )

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the last link's columns of the regressor."""
        return self.robot.rigid.regressor(motion)[:, :, -10:]
