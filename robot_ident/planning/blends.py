"""An excitation as it is played: from rest along its path, periods at full rate, and back to rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.trajectories.excitation import Excitation, Piece
from robot_ident.trajectories.extremes import certified_minimum
from robot_ident.trajectories.fourier_series import Extremes, FourierSeries, MotionExtremes
from robot_ident.trajectories.point_to_point import smooth_share

_RAMPS = np.linspace(0.3, 1.0, 29)  # shares of the period tried as the duration of a ramp, the shortest first
_LEADS = np.linspace(0.0, 0.95, 20)  # shares of the period for which it goes on at full rate before it comes to rest
_TOLERANCE = 1e-4  # of the extremes of acceleration on a ramp, as a share of the limit


class Playback:
    """The motion that plays an excitation on a robot (a `Reference`).

    It rests at a pose of the path, follows the path while the phase rate rises smoothly from 0 to 1 (so that position
    and workspace stay on the certified path), is at full rate when one period (`transient`) has passed, plays
    `periods` periods and then comes to rest by the same law, at once or where the path allows it first. For t in
    [transient, transient + periods T] the reference is series.motion(t - transient).
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
        self._rise, self._fall = (self._choose(ramp, rising=rising) for rising in (True, False))

    def _choose(self, ramp: float | None, *, rising: bool) -> Ramp:
        """Return the shortest ramp whose acceleration is certified to stay within the limits."""
        period, limits = self.excitation.period, self.robot.limits
        steady = self.excitation.series.extremes().ddq.largest
        allowed = np.maximum(limits.acceleration, steady)  # a ramp is no worse than an excitation that breaks its limit
        tried = _RAMPS * period if ramp is None else np.array([ramp])
        for lead in _LEADS[:1] if rising or ramp is not None else _LEADS:
            for duration in tried:
                span = period if rising else lead * period + duration
                candidate = Ramp(self.excitation.series, float(duration), float(span), rising)
                if np.all(candidate.top_acceleration < allowed) or not np.all(np.isfinite(allowed)):
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
        return self.steady_end + self._fall.span

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
            if rows.any():
                part = ramp.motion(t[rows] - start)
                q[rows], dq[rows], ddq[rows] = part.q, part.dq, part.ddq
        return Motion(q, dq, ddq)

    def pieces(self) -> Sequence[Piece]:
        """Return one steady period (whose times are told where a blend is as tight), the way in and the way out."""
        series = self.excitation.series
        start, steady = self.transient, _shifted(series.extremes(), self.transient)
        periodic = Piece(start, start + series.period, self.reference, steady, series.jerk_bound(), name="periodic")
        return [periodic, self._rise.piece(0.0), self._fall.piece(self.steady_end)]


@dataclass(frozen=True)
class Ramp:
    """The path of a series with its phase rate going from 0 to 1 or back.

    r(u) = 10 u^3 - 15 u^4 + 6 u^5, u = t / duration. A rising ramp is followed by the full rate until `span` [s],
    where the phase is that of t = 0; a falling one begins there, the rest of its span at full rate first.
    """

    series: FourierSeries
    duration: float
    span: float
    rising: bool

    def phase(self, t: Array) -> tuple[Array, Array, Array]:
        """Return the phase s [s], its rate r and dr/dt [1/s] at instants t [N] s of the ramp."""
        moving = t if self.rising else self.span - t
        u = np.clip(moving / self.duration, 0.0, 1.0)
        integral = self.duration * u**4 * (2.5 - 3.0 * u + u**2)
        rate, slope, _ = smooth_share(moving, self.duration)
        if not self.rising:
            lead = self.span - self.duration
            return lead + 0.5 * self.duration - integral - np.maximum(lead - t, 0.0), rate, -slope
        return integral + np.maximum(t - self.duration, 0.0) - (self.span - 0.5 * self.duration), rate, slope

    def motion(self, t: Array) -> Motion:
        """Return q(s), dq/ds r, d2q/ds2 r^2 + dq/ds dr/dt at instants t [N] s of the ramp."""
        s, rate, slope = (part[:, None] for part in self.phase(t))
        path = self.series.motion(s[:, 0])
        return Motion(path.q, path.dq * rate, path.ddq * rate**2 + path.dq * slope)

    @cached_property
    def top_acceleration(self) -> Array:
        """A proven bound [n] of |ddq| while the rate changes."""
        lead = 0.0 if self.rising else self.span - self.duration
        return self._extremes(2, lead, lead + self.duration).largest

    @cached_property
    def extremes(self) -> MotionExtremes:
        """Certified extremes of position, speed and acceleration over the span; where the path itself gives a closer
        bound (the whole path's, at a rate of 1 at most), that one.
        """
        path = self.series.extremes()
        found = [self._extremes(order, 0.0, self.span) for order in range(3)]
        steep = np.maximum(self.top_acceleration, path.ddq.largest)
        least = (path.q.lower, np.minimum(path.dq.lower, 0.0), -steep)
        most = (path.q.upper, np.maximum(path.dq.upper, 0.0), steep)
        return MotionExtremes(
            *(
                Extremes(np.maximum(e.lower, low), e.lower_time, np.minimum(e.upper, high), e.upper_time)
                for e, low, high in zip(found, least, most, strict=True)
            )
        )

    def _extremes(self, order: int, start: float, end: float) -> Extremes:
        """Return proven extremes of q (order 0), dq or ddq from `start` to `end` [s]."""
        scale = self.series.extremes()[order].largest
        low, high = np.array(
            [
                [
                    self._least(order, joint, sign, _TOLERANCE * float(scale[joint]) + 1e-12, start, end)
                    for joint in range(self.series.joints)
                ]
                for sign in (1.0, -1.0)
            ]
        ).transpose(0, 2, 1)
        return Extremes(low[0], low[1], -high[0], high[1])

    def _least(
        self, order: int, joint: int, sign: float, tolerance: float, start: float, end: float
    ) -> tuple[float, float]:
        """Return a proven lower bound of sign * a derivative of a joint's position over [start, end], and its time."""
        jerk = float(self.jerk_bound()[joint])

        def bound(centres: Array, halves: Array) -> tuple[Array, Array]:
            motion = self.motion(centres)
            signals = [part[:, joint] for part in (motion.q, motion.dq, motion.ddq)]
            drop = jerk * halves
            for slope in reversed(signals[order + 1 :]):
                drop = (np.abs(slope) + drop) * halves
            values = sign * signals[order]
            return values, values - drop

        found = certified_minimum(bound, start, end, tolerance)
        return found.lower, found.time

    def jerk_bound(self) -> Array:
        """Return a bound [n] of the jerk d3q/ds3 r^3 + 3 d2q/ds2 r dr/dt + dq/ds d2r/dt2, each factor by its largest
        value: |dr/dt| <= 15/8 / T, |d2r/dt2| <= 10/sqrt(3) / T^2.
        """
        path, duration = self.series.extremes(), self.duration
        bound = self.series.jerk_bound() + 3.0 * path.ddq.largest * 1.875 / duration
        return np.asarray(bound + path.dq.largest * (10.0 / np.sqrt(3.0)) / duration**2)

    def piece(self, start: float) -> Piece:
        """Return the ramp as a piece that begins at `start` [s]."""
        extremes, name = _shifted(self.extremes, start), "blend_in" if self.rising else "blend_out"
        motion, end = lambda t: self.motion(t - start), start + self.span
        return Piece(start, end, motion, extremes, self.jerk_bound(), name=name)


def _shifted(extremes: MotionExtremes, offset: float) -> MotionExtremes:
    return MotionExtremes(*(Extremes(e.lower, e.lower_time + offset, e.upper, e.upper_time + offset) for e in extremes))
