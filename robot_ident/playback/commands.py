"""Commands wait a moment, so that those which come late don't disturb the motion; velocity and acceleration of a robot
come from its last positions.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from robot_ident.signals.motion import Array, Motion

_FOREIGN_NS = 1_000_000_000  # a stamp further from the receive time than this is of another clock


@dataclass(frozen=True)
class Command:
    """A command of stamp t_ns [ns]: q [n] rad, dq [n] rad/s."""

    t_ns: int
    q: Array
    dq: Array


class CommandBuffer:
    """Hands out each command `delay` seconds after its stamp, whatever its way took, in the order of the stamps.

    A missing stamp, or one of another clock, is replaced by the receive time: one far from it that does not follow on
    the stamps of this clock, as those of commands do that waited while nobody took them. One thread fills it, another
    empties it.
    """

    def __init__(self, delay: float) -> None:
        """Hold commands back for `delay` [s]."""
        self.delay_ns = round(delay * 1e9)
        self._commands: deque[Command] = deque()
        self._own_ns: int | None = None  # the newest stamp of this clock

    def put(self, stamp_ns: int, received_ns: int, q: Array, dq: Array) -> None:
        """Take in a command; one that is older than its predecessor is left out."""
        waited = self._own_ns is not None and self._own_ns < stamp_ns < received_ns
        own = waited or abs(stamp_ns - received_ns) < _FOREIGN_NS
        if own:
            self._own_ns = stamp_ns
        t = stamp_ns if own else received_ns
        if not self._commands or t > self._commands[-1].t_ns:
            self._commands.append(Command(t, q, dq))

    def due(self, now_ns: int) -> list[Command]:
        """Return the commands whose time has come, the oldest first."""
        out = []
        while self._commands and self._commands[0].t_ns + self.delay_ns <= now_ns:
            out.append(self._commands.popleft())
        return out

    def shift(self, by_ns: int) -> None:
        """Let the stamps go along with a clock that has jumped by so much [ns]."""
        if self._own_ns is not None:
            self._own_ns += by_ns
        for k in range(len(self._commands)):  # those that come meanwhile are of the new time
            self._commands[k] = replace(self._commands[k], t_ns=self._commands[k].t_ns + by_ns)

    def clear(self) -> None:
        """Forget what waits."""
        self._commands.clear()


_DEGREE = 4
_FEWEST = 11  # samples, that the polynomial smooths more than it follows
_UNEVEN = 0.2  # share of the spacing by which it may differ from what it was before the window is sized anew


@dataclass(frozen=True)
class LocalState:
    """The motion [1, n] at one sample, with what was measured there: its stamp [ns] and torque [n]."""

    stamp_ns: int
    motion: Motion
    tau: Array


class LocalMotion:
    """Fits a polynomial of degree 4 to the positions in a sliding window and differentiates it at its middle sample.

    q(t) = sum_k c_k (t - t_m)^k by least squares over the real stamps; dq = c_1, ddq = 2 c_2 (Savitzky, Golay 1964).
    The answer lags by half the window: 0.2 s at 150 Hz turn position noise of 4e-5 rad into 0.016 rad/s^2. The window
    has an odd number of samples, learnt from their spacing, so that every sample is the middle once.
    """

    def __init__(self, window: float) -> None:
        """Use a window of `window` [s]."""
        self.window = window
        self._samples: deque[tuple[int, Array, Array]] = deque()
        self._spacing = 0.0
        self._count = _FEWEST
        self._key: bytes = b""
        self._inverse: Array = np.zeros((0, 0))

    def reset(self) -> None:
        """Forget the samples."""
        self._samples.clear()

    def add(self, stamp_ns: int, q: Array, tau: Array) -> LocalState | None:
        """Take in a sample; return the state at the middle of the window, None while it isn't filled without gaps."""
        if self._samples and stamp_ns <= self._samples[-1][0]:
            self._samples.clear()
        self._samples.append((stamp_ns, q, tau))
        if len(self._samples) < _FEWEST:
            return None
        stamps = np.array([sample[0] for sample in self._samples])
        steps = np.diff(stamps)
        usual = float(np.median(steps))
        if abs(usual - self._spacing) > _UNEVEN * self._spacing:
            self._spacing = usual
            self._count = max(_FEWEST, round(self.window * 1e9 / usual)) | 1
        if len(self._samples) < self._count:
            return None
        while len(self._samples) > self._count:
            self._samples.popleft()
        stamps = stamps[-self._count :]
        if np.diff(stamps).max() > 2.5 * usual:
            return None
        middle = self._count // 2
        fit = self._coefficients(stamps - stamps[middle]) @ np.array([sample[1] for sample in self._samples])
        scale = 2.0 / self.window
        motion = Motion(fit[:1], fit[1:2] * scale, 2.0 * fit[2:3] * scale**2)
        return LocalState(int(stamps[middle]), motion, self._samples[middle][2])

    def _coefficients(self, offsets: np.ndarray) -> Array:
        """Return the pseudo-inverse [degree + 1, N] of the powers of time; kept while the stamps stay even to 1 us."""
        key = (offsets // 1000).tobytes()
        if key != self._key:
            x = offsets * (2e-9 / self.window)
            powers = np.vander(x, _DEGREE + 1, increasing=True)
            self._key, self._inverse = key, np.asarray(np.linalg.pinv(powers), dtype=float)
        return self._inverse
