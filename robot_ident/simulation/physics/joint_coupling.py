"""A shaft of the plant that belongs to another joint and runs through this one."""

from __future__ import annotations

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, damping, dry_friction

EDGE = 0.004
"""Speed [rad/s] over which the shaft's friction changes its direction: its seals give a little."""


class JointCoupling(Physics):
    """Friction that the shaft of another joint leaves in this one: c (2 / pi) atan(dq_o / e) + b dq_o, and its inertia.

    other: number of the other joint, from 1. c [Nm], b [Nm s/rad]. inertia [kg m^2] couples both ways.
    """

    name = "joint_coupling"
    parameters = (
        Value("coulomb", "Nm", "N"),
        Value("viscous", "Nm s/rad", "N s/m"),
        Value("inertia", "kg m^2", "kg"),
        Value("other", "1", "1", lower=1, structural=True),
    )
    largest = 3.0
    sizes = ("coulomb", "viscous")

    def __init__(self, robot: Robot, joint: int | None, values: dict[str, float]) -> None:
        """Place it; the other joint must be another one of this robot."""
        other = values.get("other")
        if other is not None and (other not in range(1, robot.n + 1) or other == (joint or 0) + 1):
            from robot_ident.errors import InputError

            raise InputError(
                f"{self.name}@{robot.joints[joint or 0]}: other = {other:g}; the number of another joint, from 1 to"
                f" {robot.n}, is needed"
            )
        super().__init__(robot, joint, values)

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a fifth of this joint's Coulomb friction and a tenth of its viscous one, of a neighbour."""
        other = joint + 2 if joint + 1 < robot.n else joint
        dry, wet = 0.2 * dry_friction(robot, joint), 0.1 * damping(robot, joint)
        return {"coulomb": dry, "viscous": wet, "inertia": 0.0, "other": float(max(other, 1))}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return dry and viscous friction in any proportion, of any other joint."""
        usual, share = cls.typical(robot, joint), rng.uniform(0.2, 1.0)
        other = rng.choice([k + 1 for k in range(robot.n) if k != joint])
        return usual | {
            "coulomb": usual["coulomb"] * share,
            "viscous": usual["viscous"] * (1.2 - share),
            "other": float(other),
        }

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether there is another joint."""
        return robot.n > 1

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque at this joint."""
        other = int(self.values["other"]) - 1
        v = x.v[other]
        torque = self.values["coulomb"] * 2 / np.pi * ca.atan(v / EDGE) + self.values["viscous"] * v
        inertia = {(self.joint, other): self.values["inertia"], (other, self.joint): self.values["inertia"]}
        return Contribution(torque={self.joint: torque}, inertia=inertia)
