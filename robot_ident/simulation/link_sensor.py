"""What a torque sensor behind the gear feels: what the links need, without the losses and rotors before it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.physics import Physics
from robot_ident.simulation.physics.physics import Instant


def link_side(robot: Robot) -> list[int]:
    """Return the joints whose effort is measured behind the gear."""
    return [joint for joint in range(robot.n) if robot.side(joint) == "link"]


def link_torque(robot: Robot, physics: Sequence[Physics], motion: Motion) -> Array:
    """Return the torque [N, n] Nm that the links need along their true motion: rigid bodies without rotors, and the
    phenomena that act on links.

    Raises InputError where one of these has a memory or shifts the links against the motors: it isn't simulated here.
    """
    torque: Array = robot.rigid.inverse_dynamics(motion) - robot.drives.armature * motion.ddq
    q, v, a = (ca.SX.sym(name, robot.n) for name in ("q", "v", "a"))
    parts = [ca.vertsplit(x) for x in (q, v, a)]
    for one in physics:
        if one.shaft or (one.side == "link" and one.states):
            raise InputError(f"{one.label} can't be simulated where effort is measured on the link side")
        if one.side != "link":
            continue
        made = one.contribution(Instant(parts[0], parts[1], parts[2], [ca.SX(0)] * robot.n, moved=[ca.SX(0)] * robot.n))
        added = ca.SX.zeros(robot.n)
        for joint, value in made.torque.items():
            added[joint] += value
        for joint, value in made.damping.items():
            added[joint] += value * v[joint]
        for joint, value in made.friction.items():
            added[joint] += value * ca.sign(v[joint])
        for (i, j), value in made.inertia.items():
            added[i] += value * a[j]
        function = ca.Function("added", [q, v, a], [added]).map(motion.samples)
        torque = torque + np.array(function(motion.q.T, motion.dq.T, motion.ddq.T)).T
    return torque
