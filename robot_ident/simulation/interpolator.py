"""From a stream of commanded positions and velocities to a smooth reference, and to a stop when the stream ends."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robot_ident.signals.motion import Array, Motion, frozen_array

STOP_TIME = 0.2
"""How long a stop takes [s] for joints whose acceleration isn't limited."""

_ROUNDING = 1e-9  # s by which sums of periods may miss the stamps that they are to meet


_POWERS = np.arange(6.0)[:, None]
_FIRST, _SECOND = _POWERS, _POWERS * (_POWERS - 1.0)  # what a power's first and second derivative are multiplied by


@dataclass(frozen=True)
class Piece:
    """Positions sum_k c_k (t - start)^k [n] from `start` to `end` [s]; c [K, n], K <= 6."""

    start: float
    end: float
    c: Array

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq [N, n] at times [N]."""
        size = len(self.c)
        powers = np.ones((len(t), size))
        if size > 1:
            powers[:, 1] = t - self.start
        for k in range(2, size):
            powers[:, k] = powers[:, k - 1] * powers[:, 1]
        return (
            powers @ self.c,
            powers[:, : size - 1] @ (_FIRST[1:size] * self.c[1:]),
            powers[:, : max(size - 2, 0)] @ (_SECOND[2:size] * self.c[2:]),
        )

    def state(self, t: float) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq [n] at a time."""
        q, dq, ddq = self.states(np.array([t]))
        return q[0], dq[0], ddq[0]


def hermite(start: float, end: float, before: tuple[Array, Array], after: tuple[Array, Array]) -> Piece:
    """Return the cubic between two instants with position and velocity at both."""
    span = end - start
    (q0, v0), (q1, v1) = before, after
    slope = (q1 - q0) / span
    return Piece(start, end, np.stack([q0, v0, (3 * slope - 2 * v0 - v1) / span, (v0 + v1 - 2 * slope) / span**2]))


def braking(start: float, q: Array, v: Array, acceleration: Array) -> Piece:
    """Return the smoothest stop within acceleration limits [n]: v(s) = v (1 - 3 s^2 + 2 s^3), s from 0 to 1.

    All joints stop at once, so that the path goes on straight; the deceleration is largest, 1.5 |v| / T, half-way and
    zero at both ends.
    """
    limited = np.isfinite(acceleration) & (acceleration > 0)
    times = np.where(limited, 1.5 * np.abs(v) / np.where(limited, acceleration, 1.0), np.where(v != 0, STOP_TIME, 0.0))
    span = max(float(times.max(initial=0.0)), 1e-6)
    return Piece(start, start + span, np.stack([q, v, 0 * v, -v / span**2, v / (2 * span**3)]))


def settling(start: float, q: Array, v: Array, acceleration: Array) -> Piece:
    """Return the way from offset q and rate v [n] to nothing: the quintic that ends, and begins, unaccelerated.

    With s = (t - start) / T: q (1 - 10 s^3 + 15 s^4 - 6 s^5) + v T (s - 6 s^3 + 8 s^4 - 3 s^5). The two parts
    accelerate by at most 10 / sqrt(3) |q| / T^2 and 3.95 |v| / T; T is the least that keeps their sum within
    `acceleration` [n].
    """
    limited = np.isfinite(acceleration) & (acceleration > 0)
    a = np.where(limited, acceleration, 1.0)
    slow, far = 3.95 * np.abs(v), 10.0 / np.sqrt(3.0) * np.abs(q)
    times = np.where(limited, (slow + np.sqrt(slow**2 + 4.0 * far * a)) / (2.0 * a), STOP_TIME)
    span = max(float(times[(q != 0) | (v != 0)].max(initial=0.0)), 1e-6)
    rate = v / span**2
    rows = [q, v, 0 * q, -10 * q / span**3 - 6 * rate, (15 * q / span**3 + 8 * rate) / span]
    return Piece(start, start + span, np.stack([*rows, (-6 * q / span**3 - 3 * rate) / span**2]))


class CommandInterpolator:
    """Plays commands one command period late, as cubics through their positions and velocities.

    Times are those of the commands' own stamps [s], so that jitter of their arrival doesn't reach the reference. When
    the next command is late the reference goes on with its last acceleration for `patience` seconds, then the joints
    brake within `acceleration` [n] rad/s^2 and hold. A stream that begins anew is joined smoothly from wherever the
    reference is.
    """

    def __init__(self, acceleration: ArrayLike, period: float, *, patience: float | None = None) -> None:
        """Expect commands every `period` seconds; `patience` is one period unless it is given."""
        self.acceleration = frozen_array(acceleration, None)
        self.period = float(period)
        self.patience = self.period if patience is None else float(patience)
        self.reset(np.zeros(len(self.acceleration)))

    def reset(self, q: ArrayLike) -> None:
        """Hold position q [n] and forget all commands."""
        self._spacing = self.period
        self._now = 0.0
        self._last: float | None = None  # stamp of the last command
        self._newest = Piece(0.0, np.inf, frozen_array(q, len(self.acceleration))[None])  # which leads to it
        self._goal = self._newest.c[0], 0 * self._newest.c[0]
        self._pieces = deque([self._newest])
        self._offset: Piece | None = None  # from what was left out to the present

    @property
    def holding(self) -> bool:
        """Whether the reference stands still for want of commands."""
        return self._last is None

    @property
    def behind(self) -> float:
        """How far the reference is behind the newest command [s]: one period, where commands come one by one."""
        return 0.0 if self._last is None else max(self._last - self._now, 0.0)

    def push(self, t: float, q: ArrayLike, dq: ArrayLike) -> bool:
        """Take the command of stamp t [s]: positions q [n] and velocities dq [n].

        Returns False where it is left out, being no newer than the last one; ValueError on values that aren't finite.
        """
        goal = frozen_array(q, len(self.acceleration)), frozen_array(dq, len(self.acceleration))
        if not (np.isfinite(t) and np.isfinite(goal[0]).all() and np.isfinite(goal[1]).all()):
            raise ValueError("a command that is not finite")
        last = self._last
        if last is not None and t <= last:
            return False
        if last is not None and t - last < 4 * self.period:
            self._spacing = t - last
        if last is None or self._now > last + _ROUNDING:
            self._join(t, goal)
        else:
            self._newest = hermite(last, t, self._goal, goal)
            self._pieces.append(self._newest)
        self._last, self._goal = t, goal
        return True

    def catch_up(self) -> None:
        """Leave out the commands that wait, but for the newest: what is played is one command late again.

        The reference goes on from where it is: its distance from the present settles within `acceleration`.
        """
        if self._last is None or self._now >= self._last - self._spacing:
            return
        q, v, _ = self._at(np.array([self._now]))
        self._now = self._last - self._spacing
        self._forget()
        there_q, there_v, _ = self._newest.states(np.array([self._now]))
        self._offset = settling(self._now, q[0] - there_q[0], v[0] - there_v[0], self.acceleration)

    def advance(self, instants: int, spacing: float) -> Motion:
        """Return the reference [instants, n] at spacing, 2 spacing, ... [s] from now, and move on to the last."""
        q, dq, ddq = self._at(self._now + spacing * np.arange(1.0, instants + 1.0))
        self._now += instants * spacing
        self._forget()
        return Motion(q, dq, ddq)

    def _at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return the reference [N, n] at times [N] that rise, none before now."""
        if self._last is not None and times[-1] > self._last + _ROUNDING and self._pieces[-1] is self._newest:
            self._pieces.extend(self._onward(self._newest))
        q, dq, ddq = np.empty((3, len(times), len(self.acceleration)))
        row = 0
        for piece in self._pieces:
            until = int(np.searchsorted(times, piece.end + _ROUNDING, side="right"))
            if until > row:
                rows = slice(row, until)
                q[rows], dq[rows], ddq[rows] = piece.states(times[rows])
                row = until
            if row == len(times):
                break
        if self._offset is not None:
            settles = slice(0, int(np.searchsorted(times, self._offset.end)))
            for part, more in zip((q, dq, ddq), self._offset.states(times[settles]), strict=True):
                part[settles] += more
        return q, dq, ddq

    def _join(self, t: float, goal: tuple[Array, Array]) -> None:
        """Begin anew, or catch up with a stream that was late: from where the reference is to the command at t."""
        q, v, _ = self._at(np.array([self._now]))
        if self._last is None or not 0.5 * self._spacing <= t - self._now <= 2 * self._spacing:
            self._now = t - self._spacing
        self._newest = hermite(self._now, t, (q[0], v[0]), goal)
        self._pieces, self._offset = deque([self._newest]), None

    def _onward(self, piece: Piece) -> list[Piece]:
        """Return what is played after a piece when no other command comes: on, braking, hold."""
        t = piece.end
        q, v, a = piece.state(t)
        if not v.any():
            return [Piece(t, np.inf, q[None])]
        on = Piece(t, t + self.patience, np.stack([q, v, np.clip(a, -self.acceleration, self.acceleration) / 2]))
        stop = braking(on.end, *on.state(on.end)[:2], self.acceleration)
        return [on, stop, Piece(stop.end, np.inf, stop.state(stop.end)[0][None])]

    def _forget(self) -> None:
        """Drop what has been played; the last command, too, once the reference holds."""
        while len(self._pieces) > 1 and self._pieces[0].end <= self._now:
            self._pieces.popleft()
        if self._offset is not None and self._offset.end <= self._now:
            self._offset = None
        if self._last is not None and self._now > self._last and self._pieces[0].end == np.inf:
            self._last = None
