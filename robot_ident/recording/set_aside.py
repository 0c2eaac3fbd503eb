"""What of a recording lies outside the periods that are averaged, and why, in words."""

from __future__ import annotations

import numpy as np

from robot_ident.motion import Array
from robot_ident.recording.clock import Clock

_MANY = 2.0  # periods of motion before those that are averaged, from which on it is more than approach and transient
_PAUSE = 1.0  # s without samples that are named


def set_aside(clock: Clock, period: float, before: float, after: float) -> list[str]:
    """Return a line each on `before` and `after` the averaged periods [s], of a recording on a clock; period [s].

    Motion of two periods and more before them isn't the way in: it repeats, but not as they do, or not in step.
    """
    t = clock.t - clock.t[0]
    first = _told(t, 0.0, before, period, "before the periods")
    if before > 0 and not first:
        first = f"{before:.3g} s of approach and transient left out"
    last = _told(t, float(t[-1]) - after, float(t[-1]), period, "after the periods")
    if after > 0 and not last:
        last = f"{after:.3g} s after the periods left out"
    return [line for line in (first, last) if line]


def _told(t: Array, start: float, end: float, period: float, where: str) -> str:
    """Return what lies between two times, where there is a pause or much motion."""
    steps = np.diff(t)
    pauses = np.flatnonzero((steps > _PAUSE) & (t[1:] > start) & (t[:-1] < end))
    silent = float(steps[pauses].sum())
    moving = max(end - start - silent, 0.0)
    said = [f"no samples for {steps[k]:.4g} s from {t[k]:.4g} s on" for k in pauses[:3]]
    if moving >= _MANY * period:
        said.append(
            f"{int(moving / period)} periods that are not in step with the others (a pause, another motion, or a clock"
            " that drifts or jumps)"
        )
    return f"{end - start:.4g} s {where} left out: {'; '.join(said)}" if said else ""
