"""What a reported effort is held against while a robot is moved: a torque limit, or the current limit of a drive."""

from __future__ import annotations

import numpy as np

from robot_ident.recording.effort import joint_torque
from robot_ident.robot import Robot
from robot_ident.signals.motion import Array


class EffortLoad:
    """Torque at the joints in Nm (N), by the declared sign, gain, ratio and coupling; A of a drive of unknown gain.

    bounds [n]: the robot's limit of each joint in that unit, inf where nobody knows one. units [n].
    """

    def __init__(self, robot: Robot) -> None:
        """Take the robot's limits: torque where effort tells it, else the current that its YAML allows a drive."""
        ampere = np.array([robot.in_ampere(joint) for joint in range(robot.n)])
        current = np.array([robot.effort.of(joint).quantity == "current" for joint in robot.joints])
        torque = robot.compares_with_newton_metres & ~ampere
        if robot.effort.coupling is not None:
            torque &= ~((robot.effort.coupling != 0) @ ampere)
        limits = robot.limits
        torque &= np.isfinite(limits.torque) | ~current | ~np.isfinite(limits.current)
        self.bounds: Array = np.where(torque, limits.torque, np.where(current, limits.current, np.inf))
        units = ("N" if prismatic else "Nm" for prismatic in robot.prismatic)
        self.units = tuple(unit if there else "A" for unit, there in zip(units, torque, strict=True))
        self._robot, self._torque = robot, torque

    def of(self, reported: Array, q: Array) -> Array:
        """Return what is held against the bounds [n], of efforts as reported [n] at positions q [n] rad; nan: none."""
        torque = joint_torque(reported[None], q[None], self._robot)[0]
        return np.where(self._torque, torque, reported * self._robot.effort.drives(self._robot.joints))

    @property
    def unwatched(self) -> tuple[str, ...]:
        """A line for joints whose effort has nothing to be held against, with what would help."""
        lacking = ~np.isfinite(self.bounds)
        names: dict[str, list[str]] = {"A": [], "torque": []}
        for joint, unit, without in zip(self._robot.joints, self.units, lacking, strict=True):
            if without:
                names["A" if unit == "A" else "torque"].append(joint)
        ways = {
            "A": "it is a current of unknown Nm/A: give `current` [A], the largest of the drive, or `torque_constant`",
            "torque": "no torque limit is known: give `torque` [Nm]",
        }
        return tuple(
            f"the effort of {', '.join(joints)} is not watched, and rehearsals judge tracking alone there: {ways[kind]}"
            f" in the robot YAML, under joints: {joints[0]}"
            for kind, joints in names.items()
            if joints
        )
