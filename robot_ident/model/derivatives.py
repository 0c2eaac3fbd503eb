"""How the torque of a model changes with position, velocity and acceleration: exact, no differences."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from robot_ident.effects import Effect, Signals
from robot_ident.model.structure import Structure
from robot_ident.signals.motion import Array, Motion


@dataclass(frozen=True)
class TorqueDerivatives:
    """d tau_i / d q_j, d tau_i / d dq_j, d tau_i / d ddq_j along a motion, each [N, n, n]; row i, column j.

    neglected: labels of effects whose columns are no function of the present state; their share is left out.
    """

    position: Array
    velocity: Array
    acceleration: Array
    neglected: tuple[str, ...] = ()


def torque_derivatives(structure: Structure, motion: Motion, values: Array) -> TorqueDerivatives:
    """Return the derivatives of Phi(q, dq, ddq) theta for theta = values [p] (sign(dq) counts as constant).

    The rigid part is Carpentier and Mansard's analytical derivative of recursive Newton-Euler ("Analytical
    derivatives of rigid body dynamics algorithms", 2018), on inertias that give the same torque as the base parameters.
    """
    rigid = _rigid(structure, motion, values[: len(structure.base.columns)])
    parts = (structure.reported(rigid[0]), structure.reported(rigid[1]), structure.reported(rigid[2]))
    neglected = []
    for effect, own in structure.placed:
        if effect.uses_torque or not effect.symbolic:
            neglected.append(effect.label)
            continue
        for whole, part in zip(parts, _of_effect(effect, motion, values[own]), strict=True):
            whole += structure.reported(part) if effect.through_links else part
    return TorqueDerivatives(*parts, neglected=tuple(neglected))


def _rigid(structure: Structure, motion: Motion, base: Array) -> tuple[Array, Array, Array]:
    import pinocchio

    robot = structure.robot
    model = pinocchio.Model(robot.rigid.model)
    # any masses with any inertias, the base parameters then set right: Pinocchio divides by the mass
    standard = np.tile([1.0] + [0.0] * 9, robot.n)
    standard[list(structure.base.columns)] += base - structure.base.values(standard, np.zeros(robot.n))
    for link in range(robot.n):
        own = standard[10 * link : 10 * link + 10]
        model.inertias[1 + link] = pinocchio.Inertia.FromDynamicParameters(own)
    model.armature = np.zeros(robot.n)
    data = model.createData()
    out = np.empty((3, motion.samples, robot.n, robot.n))
    for k in range(motion.samples):
        pinocchio.computeRNEADerivatives(model, data, motion.q[k], motion.dq[k], motion.ddq[k])
        out[0, k], out[1, k], out[2, k] = data.dtau_dq, data.dtau_dv, data.M
    mass = out[2]
    mass += np.triu(mass, 1).transpose(0, 2, 1) - np.tril(mass, -1)
    return out[0], out[1], mass


def _of_effect(effect: Effect, motion: Motion, share: Array) -> tuple[Array, Array, Array]:
    import casadi as ca

    n = effect.robot.n
    q, dq, ddq = ca.SX.sym("q", n), ca.SX.sym("dq", n), ca.SX.sym("ddq", n)
    mathematics: Any = SimpleNamespace(
        sin=ca.sin, cos=ca.cos, exp=ca.exp, sqrt=ca.sqrt, sign=ca.sign, fabs=ca.fabs, tanh=ca.tanh
    )
    torque = ca.SX(n, 1)
    for size, term in zip(
        share, effect.terms(Signals(*(ca.vertsplit(x) for x in (q, dq, ddq))), mathematics), strict=True
    ):
        for joint, value in term.items():
            torque[joint] += float(size) * value
    out = []
    for x in (q, dq, ddq):
        slope = ca.Function("slope", [q, dq, ddq], [ca.densify(ca.jacobian(torque, x))])
        if ca.jacobian(torque, x).nnz() == 0:
            out.append(np.zeros((motion.samples, n, n)))
            continue
        found = np.array(slope.map(motion.samples)(motion.q.T, motion.dq.T, motion.ddq.T))
        out.append(found.reshape(n, motion.samples, n).transpose(1, 0, 2))
    return out[0], out[1], out[2]
