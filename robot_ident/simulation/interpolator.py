"""From a stream of commanded positions and velocities to a smooth reference, and to a stop when the stream ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from robot_ident.motion import Array, Motion, frozen_array

STOP_TIME = 0.2
"""How long a stop takes [s] for joints whose acceleration isn't limited."""


@dataclass(frozen=True)
class Piece:
    """Positions sum_k c_k (t - start)^k [n] from `start` to `end` [s]; c [K, n]."""

    start: float
    end: float
    c: Array

    def states(self, t: Array) -> tuple[Array, Array, Array]:
        """Return q, dq, ddq [N, n] at times [N]."""
        k = np.arange(len(self.c))
        powers = np.asarray(t - self.start)[:, None] ** k
        k = k[:, None]
        rate, curve = (k * self.c)[1:], (k * (k - 1) * self.c)[2:]
        return powers @ self.c, powers[:, :-1] @ rate, powers[:, :-2] @ curve

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
        self._last: float | None = None
        self._pieces = [Piece(0.0, np.inf, frozen_array(q, len(self.acceleration))[None])]

    @property
    def holding(self) -> bool:
        """Whether the reference stands still for want of commands."""
        return self._last is None

    def push(self, t: float, q: ArrayLike, dq: ArrayLike) -> bool:
        """Take the command of stamp t [s]: positions q [n] and velocities dq [n].

        Returns False where it is left out, being no newer than the last one; ValueError on values that aren't finite.
        """
        goal = frozen_array(q, len(self.acceleration)), frozen_array(dq, len(self.acceleration))
        if not (np.isfinite(t) and np.isfinite(goal[0]).all() and np.isfinite(goal[1]).all()):
            raise ValueError("a command that is not finite")
        self._forget()
        if self._last is not None and t <= self._last:
            return False
        if self._last is not None and t - self._last < 4 * self.period:
            self._spacing = t - self._last
        if self._last is None or self._now > self._last:
            self._join(t, goal)
        else:
            keep = [piece for piece in self._pieces if piece.end <= self._last]
            start = self._state(self._last)[:2]
            self._pieces = [*keep, *self._onward(hermite(self._last, t, start, goal))]
        self._last = t
        return True

    def advance(self, instants: int, spacing: float) -> Motion:
        """Return the reference [instants, n] at spacing, 2 spacing, ... [s] from now, and move on to the last."""
        times = np.asarray(self._now + spacing * np.arange(1, instants + 1), dtype=float)
        q, dq, ddq = np.empty((3, instants, len(self.acceleration)))
        begin = -np.inf
        for piece in self._pieces:
            rows = (begin <= times) & (times < piece.end)
            q[rows], dq[rows], ddq[rows] = piece.states(times[rows])
            begin = piece.end
        self._now += instants * spacing
        self._forget()
        return Motion(q, dq, ddq)

    def _join(self, t: float, goal: tuple[Array, Array]) -> None:
        """Begin anew, or catch up with a stream that was late: from where the reference is to the command at t."""
        q, v, _ = self._state(self._now)
        if self._last is None or not 0.5 * self._spacing <= t - self._now <= 2 * self._spacing:
            self._now = t - self._spacing
        self._pieces = self._onward(hermite(self._now, t, (q, v), goal))

    def _onward(self, piece: Piece) -> list[Piece]:
        """Return a piece and what is played after it when no other command comes: on, braking, hold."""
        t = piece.end
        q, v, a = piece.state(t)
        if not v.any():
            return [piece, Piece(t, np.inf, q[None])]
        on = Piece(t, t + self.patience, np.stack([q, v, np.clip(a, -self.acceleration, self.acceleration) / 2]))
        stop = braking(on.end, *on.state(on.end)[:2], self.acceleration)
        return [piece, on, stop, Piece(stop.end, np.inf, stop.state(stop.end)[0][None])]

    def _state(self, t: float) -> tuple[Array, Array, Array]:
        return next(piece for piece in self._pieces if t < piece.end).state(t)

    def _forget(self) -> None:
        """Drop what has been played; the last command, too, once the reference holds."""
        self._pieces = [piece for piece in self._pieces if piece.end > self._now]
        if self._last is not None and self._now > self._last and len(self._pieces) == 1:
            self._last = None
