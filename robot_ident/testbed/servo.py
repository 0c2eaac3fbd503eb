"""The joint servos: what torque a drive gives for a reference and a state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.phenomena import nominal_physics
from robot_ident.testbed.phenomena.phenomenon import Instant, home_inertia
from robot_ident.testbed.vectorised import vectorised

SERVOS = {
    "feedforward": "full feed-forward of the reference, friction included, and a position controller: a tuned drive",
    "pd": "position controller alone: friction makes the joints stick, slip and lag behind",
}

BANDWIDTH = 8.0
"""Bandwidth of the position controllers [Hz]: usual for industrial arms, well below their first resonance."""


@dataclass(frozen=True)
class Servo:
    """tau = tau_ff + kp (q_ref - q) + kd (dq_ref - dq), within the torque limits; each joint for itself.

    kp [n] Nm/rad, kd [n] Nm s/rad. Without an integral part: a joint at rest then stands still instead of hunting about
    its goal, and the error that gravity leaves is small at the usual gains. `feed_forward` maps
    (q, dq, ddq) [N, n] to smooth torque and level of dry friction [N, n]; None: there is none.
    """

    kp: Array
    kd: Array
    limit: Array
    feed_forward: Callable[..., tuple[Array, ...]] | None = None

    @classmethod
    def make(cls, robot: Robot, kind: str = "feedforward", bandwidth: float = BANDWIDTH) -> Servo:
        """Return the servo of a robot; InputError on an unknown kind.

        Gains from the inertia at the home pose: kp = M_ii w^2, kd = 2 M_ii w, w = 2 pi bandwidth (critical damping).
        """
        if kind not in SERVOS:
            raise InputError(f"unknown servo {kind!r}{did_you_mean(kind, SERVOS)}")
        if not 0 < bandwidth < np.inf:
            raise InputError(f"servo bandwidth {bandwidth} Hz: a positive number is needed")
        w, inertia = 2 * np.pi * bandwidth, home_inertia(robot)
        ahead = _feed_forward(robot) if kind == "feedforward" else None
        return cls(inertia * w**2, 2 * inertia * w, robot.limits.torque, ahead)

    def ahead(self, reference: Motion) -> tuple[Array, Array]:
        """Return the feed-forward of a reference: smooth torque [N, n] and level of dry friction [N, n], Nm."""
        if self.feed_forward is None or not reference.samples:
            return np.zeros(reference.q.shape), np.zeros(reference.q.shape)
        smooth, level = self.feed_forward(reference.q, reference.dq, reference.ddq)
        return smooth, level

    def torque(self, reference: Motion, q: Array, dq: Array) -> Array:
        """Return the torque [N, n] Nm at instants with reference and state, exactly there: what a drive reports."""
        smooth, level = self.ahead(reference)
        tau = smooth + level * np.sign(reference.dq) + self.kp * (reference.q - q) + self.kd * (reference.dq - dq)
        return np.asarray(np.clip(tau, -self.limit, self.limit))


def _feed_forward(robot: Robot) -> Callable[..., tuple[Array, ...]]:
    """Return the inverse dynamics of the robot's description, its friction, spring and offset included.

    Hidden effects aren't known to the drive, nor are states that it doesn't measure.
    """
    import casadi as ca

    from robot_ident.testbed.links import links_function

    n = robot.n
    q, dq, ddq = (ca.SX.sym(name, n) for name in ("q", "dq", "ddq"))
    mass, bias = links_function(robot)(q, dq)
    tau, level = ca.mtimes(mass, ddq) + bias, ca.SX.zeros(n)
    signals, nothing = [ca.vertsplit(s) for s in (q, dq, ddq, ca.SX(tau))], [ca.SX(0)] * n
    x = Instant(signals[0], signals[1], signals[2], signals[3], command=nothing, moved=nothing)
    for physics in nominal_physics(robot):
        if not physics.states:
            physics.contribution(x).add_to(tau, level, dq, ddq)
    return vectorised(ca.Function("feed_forward", [q, dq, ddq], [ca.densify(tau), ca.densify(level)]))
