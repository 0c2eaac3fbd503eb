"""A force on a link from outside: a hose, a dress pack, a spring to the surroundings."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from robot_ident.effects.effect import Coefficient, Effect, Mathematics, Signals, Torques
from robot_ident.effects.rigid_arm import apart_from_links, random_states
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

_FORCE, _STIFFNESS = 1e3, 1e3  # N, N/m: what no hose pulls with
_MOTIONS = 16  # whose columns are kept


class ExternalForce(Effect):
    """A force F - k p on the end p of a joint's link, in the base's axes: the drives carry
    tau = -(dp/dq)' (F - k p).

    The end is where the next joint sits, on the last link the end effector. A rope or a hose to a fixed point is, to
    first order in its length, a constant force and a spring. What merges with gravity on the links, or leads to the
    torque of the others, has no coefficient.
    """

    name = "external_force"
    equation = "-(dp/dq)' (F - k p), p = end of the joint's link in the base"
    meaning = "force on a link from outside: hose, dress pack, spring"
    coefficients = (
        *(Coefficient(f"F{axis}", "N", "N", largest=_FORCE) for axis in "xyz"),
        Coefficient("k", "N/m", "N/m", largest=_STIFFNESS),
    )
    symmetry = "conservative"
    signature = "static over the pose, on all joints up to the link"
    confused_with = ("base_tilt", "cable", "gravity_spring", "torque_offset")
    also_like = ("something that the link touches",)
    experiment = "take off the hoses and cables that lead to the link, and record the same motion again"
    magnitude = "5-50 N / 1-10 N"
    loads_gear = True
    through_links = True

    def __init__(self, robot: Robot, joint: int | None, setting: Mapping[str, float] | None = None) -> None:
        """Leave out what merges with gravity on the links, and what gives no torque of its own."""
        super().__init__(robot, joint, setting)
        self._known: deque[tuple[Array, Array]] = deque(maxlen=_MOTIONS)  # they depend on nothing that a fit changes
        kept = _apart(robot, self.joint)
        self.coefficients = tuple(c for k, c in enumerate(type(self).coefficients) if k in kept)

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Have a link whose end a joint moves, and efforts of one unit."""
        if joint is None:
            return "a force acts on a link"
        if any(robot.in_ampere(j) for j in range(joint + 1)):
            return "effort is measured in A: what a force makes of several joints takes their motors' constants"
        return None if _apart(robot, joint) else "no force on the end of this link makes a torque of its own"

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the torque against 1 N along x, y, z, and against a spring of 1 N/m to the base's origin."""
        made = next((known for q, known in self._known if q is motion.q), None)
        if made is None:
            made = _along(self.robot, self.joint, motion.q)
            self._known.append((motion.q, made))
        return made

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return the same as expressions."""
        import casadi as ca

        from robot_ident.robot.symbolic import force_function

        torques = force_function(self.robot, self.joint)(ca.vertcat(*x.q))
        return [dict(enumerate(ca.vertsplit(column))) for column in ca.horzsplit(torques)]


def _along(robot: Robot, joint: int, q: Array) -> Array:
    """Return the torques [N, n, 4] along positions [N, n]."""
    from robot_ident.robot.symbolic import force_function

    return np.array(force_function(robot, joint)(q.T)).reshape(robot.n, len(q), 4).swapaxes(0, 1)


def _apart(robot: Robot, joint: int) -> tuple[int, ...]:
    """Return which coefficients give a torque that links can't, nor the ones before."""
    q = random_states(robot.rigid).q
    return apart_from_links(robot.rigid, _along(robot, joint, q))
