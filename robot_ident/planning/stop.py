"""A smooth stop from any state of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import polynomial

from robot_ident.limits.certifier import Certifier
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Piece
from robot_ident.trajectories.fourier_series import Extremes, MotionExtremes

_SMOOTH = np.geomspace(1.0, 4.0, 13)  # durations tried, in shares of the shortest
_SHORTEST = 1e-3  # s


@dataclass(frozen=True)
class Stop:
    """The motion of every joint to rest, as polynomials of time (a `Reference`).

    q [n, 5]: coefficients by rising power, durations [n] s. `certified`: whether it keeps position, velocity,
    acceleration and workspace.
    """

    joints: tuple[str, ...]
    coefficients: Array
    durations: Array
    certified: bool = False

    @property
    def duration(self) -> float:
        """Duration until every joint rests [s]."""
        return float(np.max(self.durations))

    @property
    def start_pose(self) -> Array:
        """Position at the start [n] rad; the joints move there, unlike at the start of other references."""
        return np.asarray(self.coefficients[:, 0])

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s; at rest after the end."""
        t = np.atleast_1d(np.asarray(t, dtype=float))
        out = np.zeros((3, len(t), len(self.joints)))
        for joint, (c, duration) in enumerate(zip(self.coefficients, self.durations, strict=True)):
            times, moving = np.clip(t, 0.0, duration), t < duration
            out[0, :, joint] = polynomial.polyval(times, c)
            for order in (1, 2):
                out[order, :, joint] = np.where(moving, polynomial.polyval(times, polynomial.polyder(c, order)), 0.0)
        return Motion(*out)

    def pieces(self) -> Sequence[Piece]:
        """Return the whole stop with its exact extremes."""
        derivatives = [
            Extremes(
                *np.array(
                    [
                        _polynomial_extremes(polynomial.polyder(c, order), duration)
                        for c, duration in zip(self.coefficients, self.durations, strict=True)
                    ]
                ).T
            )
            for order in range(4)
        ]
        jerk = derivatives[3].largest
        return [
            Piece(0.0, self.duration, self.reference, MotionExtremes(*derivatives[:3]), jerk, tuple(self.durations))
        ]


def stop_from(state: Motion, robot: Robot, certifier: Certifier | None = None) -> Stop:
    """Return a stop from a state of motion (its first sample) within the acceleration limits.

    The smoothest law that is certified is taken: speed as a cubic that begins with the present speed and acceleration
    and ends with none of either, all joints together, as short as the limits allow; where that leaves position or
    workspace limits, every joint brakes with its whole acceleration, which is the shortest way and is returned in any
    case. certifier: the robot's, where one is at hand.
    """
    q, v, a = state.q[0], state.dq[0], state.ddq[0]
    limit = robot.limits.acceleration
    limit = np.where(np.isfinite(limit), limit, np.maximum(10.0 * np.abs(v), 1e-3))  # to rest in a tenth of a second
    certifier = certifier or Certifier(robot)
    a = np.clip(a, -0.999 * limit, 0.999 * limit)
    shortest = max(float(np.max(1.5 * np.abs(v) / limit)), _SHORTEST)
    for duration in shortest * _SMOOTH:
        for initial in (a, np.zeros_like(a)):
            stop = _cubic(robot, q, v, initial, float(duration))
            if np.all(stop.pieces()[0].extremes.ddq.largest <= limit) and certifier.keeps(stop, torque=False):
                return replace(stop, certified=True)
    times = np.maximum(np.abs(v) / (0.999 * limit), _SHORTEST)
    rows = np.stack([q, v, -0.5 * v / times, 0.0 * v, 0.0 * v], axis=1)
    stop = Stop(robot.joints, rows, times)
    return replace(stop, certified=certifier.keeps(stop, torque=False))


def _cubic(robot: Robot, q: Array, v: Array, a: Array, duration: float) -> Stop:
    """Return the stop with dq(0) = v, ddq(0) = a, dq(T) = ddq(T) = 0: dq = v + a t + c t^2 + d t^3."""
    c = (-3.0 * v - 2.0 * a * duration) / duration**2
    d = (2.0 * v + a * duration) / duration**3
    return Stop(robot.joints, np.stack([q, v, a / 2.0, c / 3.0, d / 4.0], axis=1), np.full(len(q), duration))


def _polynomial_extremes(c: Array, duration: float) -> tuple[float, float, float, float]:
    """Return (least, its time, largest, its time) of a polynomial over [0, duration]."""
    slope = np.trim_zeros(polynomial.polyder(c), "b")
    roots = polynomial.polyroots(slope) if len(slope) > 1 else np.zeros(0)
    inside = [
        float(root.real) for root in roots if abs(root.imag) < 1e-9 * max(1.0, abs(root)) and 0 < root.real < duration
    ]
    times = np.array([0.0, duration, *inside])
    values = polynomial.polyval(times, c)
    low, high = int(np.argmin(values)), int(np.argmax(values))
    return float(values[low]), float(times[low]), float(values[high]), float(times[high])
