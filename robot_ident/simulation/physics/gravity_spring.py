"""Gravity spring of the plant."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot, Spring
from robot_ident.signals.motion import Motion
from robot_ident.simulation.physics.physics import Contribution, Instant, Physics, Value, strength

USUAL = Spring(0.488, 0.1)
"""A spring whose geometry is unknown is taken to be like that of the KUKA IR 361 [m]."""


class GravitySpring(Physics):
    """A spring of stiffness k and free length l0 between a fixed point at distance L from the axis and a lever r on the
    link.

    The spring's force is k (d - l0) at length d(q) = sqrt(L^2 + r^2 - 2 L r cos q), its arm L r sin(q) / d: the drive
    carries L r sin(q) (k - k l0 / d(q)), the derivative of the energy k (d - l0)^2 / 2. L (`length`) and r (`lever`)
    are the robot's where its description gives them.
    """

    name = "gravity_spring"
    parameters = (
        Value("stiffness", "N/m", "N/m", lower=0.0),
        Value("free_length", "m", "m", lower=0.0),
        Value("length", "m", "m", lower=1e-3),
        Value("lever", "m", "m", lower=1e-3),
    )
    sizes = ("stiffness",)
    side = "link"
    loads_gear = True

    def __init__(self, robot: Robot, joint: int | None, values: Mapping[str, float]) -> None:
        """Place the spring, with the robot's geometry unless another one is given."""
        super().__init__(robot, joint, self.known(robot, joint or 0) | dict(values))

    @classmethod
    def known(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return length and lever of the robot's spring at a joint, or usual ones."""
        spring = robot.springs.get(robot.joints[joint], USUAL)
        return {"length": spring.length, "lever": spring.lever}

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return a spring that is slack at its shortest and gives the joint's torque when stretched to the side."""
        spring = robot.springs.get(robot.joints[joint], USUAL)
        slack = abs(spring.length - spring.lever)
        side = (spring.length**2 + spring.lever**2) ** 0.5
        arm = spring.length * spring.lever / side
        stiffness = strength(robot, joint) / max(arm * (side - slack), 1e-9)
        return {"stiffness": stiffness, "free_length": slack, **cls.known(robot, joint)}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return another geometry where the robot has none, the spring slack at its shortest."""
        if robot.joints[joint] in robot.springs:
            return cls.typical(robot, joint)
        length = rng.uniform(0.35, 0.6)
        lever = length * rng.uniform(0.15, 0.35)
        stiffness = strength(robot, joint) / (length * lever)
        return {"stiffness": stiffness, "free_length": length - lever, "length": length, "lever": lever}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether the joint turns under a weight: elsewhere nobody needs one."""
        import pinocchio

        model = robot.rigid.model
        data, rng = model.createData(), np.random.default_rng(0)
        poses = rng.uniform(-1.0, 1.0, (5, robot.n))
        weight = max(abs(float(pinocchio.computeGeneralizedGravity(model, data, q)[joint])) for q in poses)
        return not robot.prismatic[joint] and weight > 1e-6

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque that the drive carries."""
        k, rest = self.values["stiffness"], self.values["free_length"]
        big, small, q = self.values["length"], self.values["lever"], x.q[self.joint]
        length = ca.sqrt(big**2 + small**2 - 2 * big * small * ca.cos(q))
        return Contribution(torque={self.joint: k * (length - rest) * (big * small * ca.sin(q) / length)})
