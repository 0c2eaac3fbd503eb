"""The rigid arm: torque linear in the inertial parameters of its links, computed by Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robot_ident.signals.motion import Array, Motion

# Pinocchio's order of the ten inertial parameters of a link, about and along its joint frame.
STANDARD = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
STANDARD_UNITS = ("kg", "kg m", "kg m", "kg m") + ("kg m^2",) * 6
_DEPENDENT = 1e-9  # of a rotor's torque, that the links do not make


@dataclass(frozen=True)
class RigidBody:
    """A serial chain of rigid links: tau = Y(q, dq, ddq) pi, with pi the 10 n inertial parameters.

    Inertias are tensor entries about the origin of the joint frame (Ixy = - integral of x y dm), first moments in kg m.
    `model` is the Pinocchio model, its armature included; it isn't changed.
    """

    model: Any

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.model.nv)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the 10 n standard parameters: `Izz1` is link 1's moment of inertia about its joint axis."""
        return tuple(f"{parameter}{link + 1}" for link in range(self.n) for parameter in STANDARD)

    @cached_property
    def parameters(self) -> Array:
        """Standard parameters of the URDF [10 n], SI units."""
        links = [self.model.inertias[1 + link].toDynamicParameters() for link in range(self.n)]
        return np.concatenate(links)

    @cached_property
    def prismatic(self) -> tuple[bool, ...]:
        """Which joints are prismatic."""
        return tuple(self.model.joints[1 + j].shortname().startswith("JointModelP") for j in range(self.n))

    def standing(self, gravity: tuple[float, float, float] | None) -> Any:
        """Return the Pinocchio model under a gravity [3] m/s^2, its own where none is told."""
        if gravity is None:
            return self.model
        model = self.model.copy()
        model.gravity.linear = np.array(gravity)
        return model

    def regressor(self, motion: Motion) -> Array:
        """Return Y [N, n, 10 n], Nm per unit parameter (armature isn't part of it)."""
        import pinocchio

        model = self.standing(motion.gravity)
        data = model.createData()
        y = np.empty((motion.samples, self.n, 10 * self.n))
        for k in range(motion.samples):
            y[k] = pinocchio.computeJointTorqueRegressor(model, data, motion.q[k], motion.dq[k], motion.ddq[k])
        return y

    @cached_property
    def holding_rotors(self) -> tuple[bool, ...]:
        """Whether the links' inertias make the torque of each joint's rotor: then no motion tells the rotor apart."""
        rng = np.random.default_rng(1997)
        motion = Motion(*rng.uniform(-3.0, 3.0, (3, 10 * self.n + 20, self.n)))
        y = self.regressor(motion).reshape(-1, 10 * self.n)
        rotors = np.einsum("kj,ij->kij", motion.ddq, np.eye(self.n)).reshape(-1, self.n)
        left = rotors - y @ np.linalg.lstsq(y, rotors, rcond=None)[0]
        return tuple(np.linalg.norm(left, axis=0) < _DEPENDENT * np.linalg.norm(rotors, axis=0))

    def inverse_dynamics(self, motion: Motion) -> Array:
        """Return the torque of the URDF's inertias and the armature [N, n] Nm, by recursive Newton-Euler."""
        import pinocchio

        model = self.standing(motion.gravity)
        data = model.createData()
        tau = np.empty((motion.samples, self.n))
        for k in range(motion.samples):
            tau[k] = pinocchio.rnea(model, data, motion.q[k], motion.dq[k], motion.ddq[k])
        return tau

    def frame_position(self, q: Array, frame: str) -> Array:
        """Return the origin of a named frame [N, 3] m in the base for positions q [N, n]."""
        import pinocchio

        data, index = self.model.createData(), self.model.getFrameId(frame)
        p = np.empty((len(q), 3))
        for k in range(len(q)):
            pinocchio.forwardKinematics(self.model, data, q[k])
            p[k] = pinocchio.updateFramePlacement(self.model, data, index).translation
        return p
