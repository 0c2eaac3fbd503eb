"""An excitation as it is played: from rest along its path, periods at full rate, and back to rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.approach import approach, stop_from
from robot_ident.excitation.branch_and_bound import certified_minimum
from robot_ident.excitation.excitation import Excitation
from robot_ident.excitation.fourier import Extremes, FourierSeries, MotionExtremes
from robot_ident.excitation.reference import Piece
from robot_ident.motion import Array, Motion
from robot_ident.robot.robot import Robot

__all__ = ["Playback", "approach", "stop_from"]

_RAMPS = np.linspace(0.3, 1.0, 29)  # shares of the period tried as the duration of a ramp, the shortest first
_TOLERANCE = 1e-4  # of the extremes of acceleration on a ramp, as a share of the limit


class Playback:
    """The motion that plays an excitation on a robot (a `Reference`).

    It rests at a pose of the path, follows the path while the phase rate rises smoothly from 0 to 1 (so that position
    and workspace stay on the certified path), is at full rate when one period (`transient`) has passed, plays
    `periods` periods and then comes to rest by the same law. For t in [transient, transient + periods T] the
    reference is series.motion(t - transient).
    """

    def __init__(self, excitation: Excitation, robot: Robot, periods: int, *, ramp: float | None = None) -> None:
        """Choose ramps that keep the acceleration limits (or take `ramp` [s] for both, which must keep them).

        Raises InputError for another robot, fewer periods than one, or when no ramp keeps the limits.
        """
        excitation.check_robot(robot)
        if periods < 1:
            raise InputError(f"periods = {periods}: at least one is needed")
        if ramp is not None and not 0.0 < ramp <= excitation.period:
            raise InputError(
                f"ramp = {ramp:g} s: it must be positive and no longer than a period ({excitation.period:g} s)"
            )
        self.excitation, self.robot, self.periods = excitation, robot, periods
        self._rise = self._choose(ramp, rising=True)
        self._fall = self._choose(ramp, rising=False)

    def _choose(self, ramp: float | None, *, rising: bool) -> Ramp:
        """Return the shortest ramp whose acceleration is certified to stay within the limits."""
        period, limits = self.excitation.period, self.robot.limits
        steady = self.excitation.series.extremes().ddq.largest
        allowed = np.maximum(limits.acceleration, steady)  # a ramp is no worse than an excitation that breaks its limit
        tried = _RAMPS * period if ramp is None else np.array([ramp])
        for duration in tried:
            candidate = Ramp(self.excitation.series, float(duration), period if rising else float(duration), rising)
            if np.all(candidate.extremes.ddq.largest < allowed) or not np.all(np.isfinite(allowed)):
                return candidate
        what = "blend-in" if rising else "blend-out"
        raise InputError(
            f"no {what} of {tried[0]:.3g} to {tried[-1]:.3g} s keeps the acceleration limits of {self.robot.name}"
        )

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.excitation.joints

    @property
    def transient(self) -> float:
        """Time before the first steady period [s]: one period."""
        return self.excitation.period

    @property
    def steady_end(self) -> float:
        """End of the last steady period [s]."""
        return self.transient + self.periods * self.excitation.period

    @property
    def duration(self) -> float:
        """Duration from rest to rest [s]."""
        return self.steady_end + self._fall.duration

    @property
    def start_pose(self) -> Array:
        """Position at rest before the start [n] rad."""
        return self.reference(np.zeros(1)).q[0]

    @property
    def end_pose(self) -> Array:
        """Position at rest after the end [n] rad."""
        return self.reference(np.array([self.duration])).q[0]

    def reference(self, t: Array) -> Motion:
        """Return the motion at instants t [N] s; at rest before the start and after the end."""
        t = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), 0.0, self.duration)
        steady = self.excitation.series.motion(t - self.transient)
        q, dq, ddq = steady.q.copy(), steady.dq.copy(), steady.ddq.copy()
        for rows, ramp, start in (
            (t < self.transient, self._rise, 0.0),
            (t > self.steady_end, self._fall, self.steady_end),
        ):
            part = ramp.motion(t[rows] - start)
            q[rows], dq[rows], ddq[rows] = part.q, part.dq, part.ddq
        return Motion(q, dq, ddq)

    def pieces(self) -> Sequence[Piece]:
        """Return one steady period (whose times are told where a blend is as tight), the way in and the way out."""
        series = self.excitation.series
        steady = _shifted(series.extremes(), self.transient)
        return [
            Piece(self.transient, self.transient + series.period, self.reference, steady),
            self._rise.piece(0.0),
            self._fall.piece(self.steady_end),
        ]


@dataclass(frozen=True)
class Ramp:
    """The path of a series with its phase rate going from 0 to 1 or back.

    r(u) = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration. A rising ramp is followed by the full rate until `span` [s],
    where the phase is that of t = 0; a falling one begins there.
    """

    series: FourierSeries
    duration: float
    span: float
    rising: bool

    def phase(self, t: Array) -> tuple[Array, Array, Array]:
        """Return the phase s [s], its rate r and dr/dt [1/s] at instants t [N] s of the ramp."""
        u = np.clip((t if self.rising else self.duration - t) / self.duration, 0.0, 1.0)
        integral = self.duration * u**4 * (2.5 - 3.0 * u + u**2)
        rate = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        slope = 30.0 * u**2 * (1.0 - u) ** 2 / self.duration
        if not self.rising:
            return 0.5 * self.duration - integral, rate, -slope
        return integral + np.maximum(t - self.duration, 0.0) - (self.span - 0.5 * self.duration), rate, slope

    def motion(self, t: Array) -> Motion:
        """Return q(s), dq/ds r, d2q/ds2 r^2 + dq/ds dr/dt at instants t [N] s of the ramp."""
        s, rate, slope = (part[:, None] for part in self.phase(t))
        path = self.series.motion(s[:, 0])
        return Motion(path.q, path.dq * rate, path.ddq * rate**2 + path.dq * slope)

    @cached_property
    def extremes(self) -> MotionExtremes:
        """Bounds of position and speed, which are those of the path, and certified extremes of the acceleration."""
        path = self.series.extremes()
        lower, upper = [], []
        for joint in range(self.series.joints):
            tolerance = _TOLERANCE * float(path.ddq.largest[joint]) + 1e-12
            lower.append(self._least(joint, 1.0, tolerance))
            upper.append(self._least(joint, -1.0, tolerance))
        low, low_time = np.array(lower).T
        high, high_time = np.array(upper).T
        return MotionExtremes(path.q, path.dq, Extremes(low, low_time, -high, high_time))

    def _least(self, joint: int, sign: float, tolerance: float) -> tuple[float, float]:
        """Return a proven lower bound of sign * ddq of a joint, and its time.

        By its derivative q''' r^3 + 3 q'' r dr + q' d2r, each factor by its largest value: |dr| <= 15/8 / T, |d2r| <=
        10/sqrt(3) / T^2.
        """
        path = self.series.extremes()
        jerk = float(self.series.jerk_bound()[joint])
        bend, speed = float(path.ddq.largest[joint]), float(path.dq.largest[joint])
        slope = jerk + 3.0 * bend * 1.875 / self.duration + speed * (10.0 / np.sqrt(3.0)) / self.duration**2

        def bound(centres: Array, halves: Array) -> tuple[Array, Array]:
            values = sign * self.motion(centres).ddq[:, joint]
            return values, values - slope * halves

        found = certified_minimum(bound, 0.0, self.duration, tolerance)
        return found.lower, found.time

    def piece(self, start: float) -> Piece:
        """Return the ramp as a piece that begins at `start` [s]."""
        return Piece(start, start + self.span, lambda t: self.motion(t - start), self._timed(start))

    def _timed(self, start: float) -> MotionExtremes:
        """Return the extremes with times on the playback's clock; those of the path, where the ramp passes them, else
        its end.
        """
        q, dq = (self._passed(extremes, start) for extremes in self.extremes[:2])
        lower, lower_time, upper, upper_time = self.extremes.ddq
        return MotionExtremes(q, dq, Extremes(lower, lower_time + start, upper, upper_time + start))

    def _passed(self, extremes: Extremes, start: float) -> Extremes:
        edge = np.full(self.series.joints, start + (self.span if self.rising else 0.0))
        return Extremes(extremes.lower, edge, extremes.upper, edge)


def _shifted(extremes: MotionExtremes, offset: float) -> MotionExtremes:
    return MotionExtremes(*(Extremes(e.lower, e.lower_time + offset, e.upper, e.upper_time + offset) for e in extremes))
