"""Transmissions that give: motor and link of a joint as two masses with a shaft between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.testbed.phenomena.phenomenon import Physics, home_pose

MOTOR_SHARE = 0.2
"""Part of what a joint feels that is taken as its motor's where the robot's armature is unknown."""


@dataclass(frozen=True)
class Transmissions:
    """Which coordinates are whose: the first n are the motors, each followed by its link unless a shaft lies between.

    joints: those with a shaft, whose links have the coordinates from n on. rotors [n] kg m^2: inertia of the motors
    there.
    """

    n: int
    joints: tuple[int, ...]
    rotors: Array

    @classmethod
    def of(cls, robot: Robot, physics: Sequence[Physics]) -> Transmissions:
        """Return the transmissions of a robot; InputError where a joint has two shafts."""
        joints = tuple(p.joint for p in physics if p.shaft)
        for joint in joints:
            if joints.count(joint) > 1:
                labels = " and ".join(p.label for p in physics if p.shaft and p.joint == joint)
                raise InputError(f"{labels}: a joint of the simulated robot has one transmission; leave one out")
        return cls(robot.n, joints, motor_inertia(robot, joints))

    @property
    def rows(self) -> dict[str, list[int]]:
        """Coordinate of each joint's motor and of its link."""
        n = self.n
        links = [n + self.joints.index(j) if j in self.joints else j for j in range(n)]
        return {"motor": list(range(n)), "link": links}

    def of_links(self, part: Any) -> Any:
        """Return the n entries of the links."""
        return ca.vertcat(*(part[k] for k in self.rows["link"]))

    def spread(self, mass: Any) -> Any:
        """Return the inertia of all coordinates: the arm's, of which the motors keep their own."""
        size, links = self.n + len(self.joints), self.rows["link"]
        out = ca.SX(size, size)
        out[links, links] = mass
        for joint in self.joints:
            rotor = float(self.rotors[joint])
            out[links[joint], links[joint]] -= rotor
            out[joint, joint] = rotor
        return out

    def shafts(self, given: Sequence[Physics], q: Any, v: Any, h: float) -> tuple[Any, Any]:
        """Return what the shafts take from each coordinate, and add to the inertia.

        They are twisted as velocity has it until the middle of the step; the inertia is how their torque rises with the
        step's acceleration.
        """
        size = self.n + len(self.joints)
        taken, inertia = ca.SX.zeros(size), ca.SX(size, size)
        for physics in given:
            if not physics.shaft:
                continue
            motor, link = physics.joint, self.rows["link"][physics.joint]
            rate = v[motor] - v[link]
            torque, stiffness, damping = physics.transmit(q[motor] - q[link] + h / 2 * rate, rate)
            taken[motor] += torque
            taken[link] -= torque
            held = h**2 / 4 * stiffness + h / 2 * damping
            for i, j, sign in ((motor, motor, 1), (link, link, 1), (motor, link, -1), (link, motor, -1)):
                inertia[i, j] += sign * held
        return taken, inertia


def motor_inertia(robot: Robot, joints: Sequence[int]) -> Array:
    """Return the inertia of motors [n]: the armature, or a fifth of the least that a joint feels in any pose."""
    rotors = np.array(robot.drives.armature, dtype=float)
    if all(rotors[j] > 0 for j in joints):
        return rotors
    import pinocchio

    model, rng = robot.rigid.model, np.random.default_rng(0)
    data, felt = model.createData(), []
    for _ in range(200):
        mass = pinocchio.crba(model, data, home_pose(robot) + rng.uniform(-2, 2, robot.n))
        mass = np.triu(mass) + np.triu(mass, 1).T
        felt.append(1 / np.diag(np.linalg.inv(mass)))
    return np.where(rotors > 0, rotors, MOTOR_SHARE * np.min(felt, axis=0))
