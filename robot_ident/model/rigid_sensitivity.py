"""How the torque of the rigid arm with estimated parameters changes, to first order."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from robot_ident.model.base_parameters import BaseParameters
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_MASSLESS = 1e-3  # kg, for links whose mass nothing tells: a centre of mass needs one, and a gram changes no torque


@dataclass(frozen=True)
class RigidSensitivity:
    """Derivatives of the rigid arm's torque along a motion, for base parameters values [b].

    What base parameters leave open (it has no influence on the torque along the motion) is that of the URDF. scales
    [n]: in which the joints report their torque, None: as it is.
    """

    robot: Robot
    base: BaseParameters
    values: Array
    motion: Motion
    scales: Array | None = None

    def displaced(self, displacement: Motion) -> Array:
        """Return dtau/dq e + dtau/ddq e' + M e'' [N, n] Nm for a displacement e of the links with its derivatives.

        Carpentier and Mansard, "Analytical derivatives of rigid body dynamics algorithms" (2018), by Pinocchio.
        """
        along = (displacement.q, displacement.dq, displacement.ddq)
        moved = [j for j in range(self.robot.n) if any(np.any(x[:, j]) for x in along)]
        change = np.zeros(displacement.q.shape)
        for matrix, x in zip(self.derivatives, along, strict=True):
            for j in moved:
                change += matrix[:, :, j] * x[:, [j]]
        return self.reported(change)

    def by_joint(self, joint: int) -> tuple[Array, Array, Array]:
        """Return the derivatives [N, n] of the torque by a link's position, velocity and acceleration."""
        first, second, third = (self.reported(matrix[:, :, joint]) for matrix in self.derivatives)
        return first, second, third

    def gravity(self, direction: Array) -> Array:
        """Return the torque [N, n] Nm per m/s^2 of gravity in a direction [3] of the base (it is linear in gravity)."""
        return self.reported(self._gravity @ np.asarray(direction, dtype=float))

    @cached_property
    def _gravity(self) -> Array:
        """The torque [N, n, 3] Nm per m/s^2 of gravity along x, y and z of the base."""
        import pinocchio

        model = self._model()
        out = np.empty((*self.motion.q.shape, 3))
        for axis, direction in enumerate(np.eye(3)):
            model.gravity.linear = direction
            data = model.createData()
            for row, q in zip(out[:, :, axis], self.motion.q, strict=True):
                row[:] = pinocchio.computeGeneralizedGravity(model, data, q)
        return out

    def reported(self, torque: Array) -> Array:
        """Return a torque of the arm [N, n, ...] in the scale of each joint."""
        if self.scales is None:
            return np.asarray(torque)
        return np.asarray(torque * self.scales.reshape(1, -1, *([1] * (torque.ndim - 2))))

    def mounted(self, joint: int) -> Array:
        """Return the change of torque [N, n, 3] Nm per metre by which a joint's origin moves along x, y, z of the frame
        before: the derivative by the position of a joint of three translations, put in between, at rest at its zero.
        """
        import pinocchio

        arm = self._model()
        model = pinocchio.Model()
        model.gravity = arm.gravity
        parent = 0
        for link in range(self.robot.n):
            if link == joint:
                parent = model.addJoint(parent, pinocchio.JointModelTranslation(), pinocchio.SE3.Identity(), "moved")
            name, placement = arm.names[1 + link], arm.jointPlacements[1 + link]
            parent = model.addJoint(parent, arm.joints[1 + link], placement, name)
            model.appendBodyToJoint(parent, arm.inertias[1 + link], pinocchio.SE3.Identity())
        data = model.createData()
        rows = [k for k in range(model.nv) if not joint <= k < joint + 3]
        path = (np.insert(x, [joint] * 3, 0.0, axis=1) for x in (self.motion.q, self.motion.dq, self.motion.ddq))
        out = np.empty((*self.motion.q.shape, 3))
        for k, (q, v, a) in enumerate(zip(*path, strict=True)):
            by_position, _, _ = pinocchio.computeRNEADerivatives(model, data, q, v, a)
            out[k] = by_position[rows, joint : joint + 3]
        return self.reported(out)

    @property
    def inertia(self) -> Array:
        """Inertia matrix [N, n, n] kg m^2, rotors included."""
        return self.derivatives[2]

    @cached_property
    def derivatives(self) -> tuple[Array, Array, Array]:
        """Derivatives of the torque by position, velocity and acceleration, [N, n, n] each."""
        import pinocchio

        model = self._model()
        data = model.createData()
        out = np.empty((3, self.motion.samples, self.robot.n, self.robot.n))
        for k, (q, v, a) in enumerate(zip(self.motion.q, self.motion.dq, self.motion.ddq, strict=True)):
            out[0, k], out[1, k], out[2, k] = pinocchio.computeRNEADerivatives(model, data, q, v, a)
        upper = np.triu(out[2])  # Pinocchio promises no more of the mass matrix
        mass = upper + np.triu(upper, 1).transpose(0, 2, 1)
        return out[0], out[1], mass

    def _model(self) -> Any:
        """Return the Pinocchio model whose links have these base parameters, rotors included in them."""
        import pinocchio

        model = self.robot.rigid.standing(self.motion.gravity).copy()
        model.armature = np.zeros(self.robot.n)
        for link, ten in enumerate(standard_parameters(self.robot, self.base, self.values)):
            model.inertias[1 + link] = pinocchio.Inertia.FromDynamicParameters(ten)
        return model


def standard_parameters(robot: Robot, base: BaseParameters, values: Array) -> Array:
    """Return the ten standard parameters of every link [n, 10] that give base parameters values [b]: the URDF's, with
    the selected ones set right.

    A selected parameter regroups into itself alone, so what its base parameter lacks is what it has to change by.
    """
    n = robot.n
    standard = robot.rigid.parameters.copy()
    selected = list(base.columns)
    for mass in range(0, 10 * n, 10):
        if mass not in selected and standard[mass] <= 0.0:
            standard[mass] = _MASSLESS
    standard[selected] += values - base.regrouping[:, : 10 * n] @ standard
    for mass in range(0, 10 * n, 10):
        if standard[mass] == 0.0:
            standard[mass] = _MASSLESS
    return np.asarray(standard.reshape(n, 10))
