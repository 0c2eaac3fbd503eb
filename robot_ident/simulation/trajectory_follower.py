"""What a joint trajectory controller does: follows the latest trajectory by splines and holds its last point."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from robot_ident.errors import InputError
from robot_ident.signals.motion import Array, Motion, frozen_array
from robot_ident.simulation.interpolator import Piece

_AT_REST = 1e-12  # rad/s at the last point


def quintic(start: float, end: float, before: Motion, after: Motion) -> Piece:
    """Return the polynomial of fifth order with position, velocity and acceleration [1, n] at both ends."""
    h = end - start
    known = np.stack([before.q[0], before.dq[0], 0.5 * before.ddq[0]])
    powers = np.array([[1, 1, 1], [3, 4, 5], [6, 12, 20]], dtype=float)
    reached = np.array([[1, h, h**2], [0, h, 2 * h**2], [0, 0, 2 * h**2]]) @ known
    wanted = np.stack([after.q[0], h * after.dq[0], h**2 * after.ddq[0]])
    rest = np.linalg.solve(powers, wanted - reached) / h ** np.array([[3], [4], [5]])
    return Piece(start, end, np.vstack([known, rest]))


class TrajectoryFollower:
    """Follows trajectories of timed points; each replaces the one before it from the instant at which it is taken in.

    Between points runs a quintic spline. Points of the past are passed over; where the first lies ahead, the way there
    begins at the present reference. The same rules as those of ros2_control's joint_trajectory_controller.
    """

    def __init__(self, joints: int) -> None:
        """Follow for so many joints; `reset` says where they stand."""
        self._joints = joints
        self.reset(np.zeros(joints))

    def reset(self, q: ArrayLike) -> None:
        """Hold position q [n] and forget what was to be followed."""
        self._pieces = [Piece(-np.inf, np.inf, frozen_array(q, self._joints)[None])]

    def take(self, now: float, t: Array, motion: Motion) -> None:
        """Replace what is followed at `now` [s] by points at t [K] s, motion [K, n].

        Raises InputError on what a controller refuses: values that aren't finite, times that don't rise, an end in the
        past, or one that isn't at rest.
        """
        if not all(np.isfinite(x).all() for x in (t, motion.q, motion.dq, motion.ddq)):
            raise InputError("a trajectory with values that are not finite")
        if not len(t) or np.any(np.diff(t) <= 0):
            raise InputError("a trajectory whose points don't follow one another in time")
        if t[-1] < now:
            raise InputError(f"a trajectory that ended {now - t[-1]:.3f} s ago")
        if np.abs(motion.dq[-1]).max() > _AT_REST:
            raise InputError("a trajectory that doesn't end at rest")
        points = [Motion(motion.q[k : k + 1], motion.dq[k : k + 1], motion.ddq[k : k + 1]) for k in range(len(t))]
        if t[0] > now:
            t, points = np.insert(t, 0, now), [self.at(np.array([now])), *points]
        ends = zip(t[:-1], t[1:], points[:-1], points[1:], strict=True)
        pieces = [quintic(*span) for span in ends if span[1] > now]
        self._pieces = [*pieces, Piece(float(t[-1]), np.inf, motion.q[-1:])]

    def at(self, t: Array) -> Motion:
        """Return the reference [N, n] at times t [N] s."""
        q, dq, ddq = np.empty((3, len(t), self._joints))
        begin = -np.inf
        for piece in self._pieces:
            rows = (begin <= t) & (t < piece.end)
            if rows.any():
                start = piece.start if np.isfinite(piece.start) else 0.0
                q[rows], dq[rows], ddq[rows] = Piece(start, piece.end, piece.c).states(t[rows])
            begin = piece.end
        return Motion(q, dq, ddq)
