"""The torque that a motion takes, as far as a robot's files tell: URDF, armature and `simulation`."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from robot_ident.model.expressions import columns_function
from robot_ident.model.structure import Structure
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


class TorqueModel:
    """tau = Phi(q, dq, ddq) theta with the values that the robot's files give.

    What they don't give counts as zero, and so do effects with memory and those that depend on the torque themselves.
    """

    def __init__(self, robot: Robot) -> None:
        """Read the values of a robot."""
        structure = Structure.build(robot)
        self._robot = robot
        self._structure, kept = structure.with_only(lambda effect: effect.symbolic and not effect.uses_torque)
        self._theta = structure.true_values()[kept]
        free = [
            joint
            for joint in structure.base.free_rotors
            if f"rotor_inertia@{robot.joints[joint]}" not in structure.labels
        ]
        self._rotors = np.zeros(robot.n)
        self._rotors[free] = robot.drives.armature[free]

    @property
    def known(self) -> bool:
        """Whether there is anything to limit: inertias in the URDF and at least one torque limit."""
        return bool(np.any(self._robot.rigid.parameters) and np.isfinite(self._robot.limits.torque).any())

    def function(self, sign: Any = None) -> Any:
        """Return the CasADi function (q, dq, ddq) -> tau [n]; `sign` may be a smooth stand-in for the sign function."""
        q, dq, ddq = (ca.SX.sym(name, self._robot.n) for name in ("q", "dq", "ddq"))
        phi = columns_function(self._structure, sign)(q, dq, ddq)
        tau = ca.mtimes(phi, ca.DM(self._theta)) + ca.DM(self._rotors) * ddq
        return ca.Function("torque", [q, dq, ddq], [ca.densify(tau)])

    @cached_property
    def _numeric(self) -> Any:
        return self.function()

    def torque(self, motion: Motion) -> Array:
        """Return the torque [N, n] Nm along a motion."""
        return np.array(self._numeric(motion.q.T, motion.dq.T, motion.ddq.T)).T

    def limited_joints(self, samples: int = 4000) -> tuple[int, ...]:
        """Return the joints whose torque comes near its limit in states within the other limits, by random states."""
        if not self.known:
            return ()
        limits, rng = self._robot.limits, np.random.default_rng(0)
        draw = rng.uniform(-1.0, 1.0, (3, samples, self._robot.n))
        draw[1:] = np.where(rng.uniform(size=draw[1:].shape) < 0.5, np.sign(draw[1:]), draw[1:])
        middle, half = 0.5 * (limits.upper + limits.lower), 0.5 * (limits.upper - limits.lower)
        motion = Motion(middle + half * draw[0], limits.velocity * draw[1], limits.acceleration * draw[2])
        near = np.any(np.abs(self.torque(motion)) > 0.9 * limits.torque, axis=0)
        return tuple(int(joint) for joint in np.flatnonzero(near))
