"""Where along a variable the excess error is packed most densely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

_BINS = 20  # of equal time
_CHANCE = 2.5  # standard deviations of the squared noise that an excess must have to be looked into


@dataclass(frozen=True)
class Region:
    """A stretch of a variable: the share of the excess error in it, and the share of the time spent there."""

    what: str
    lower: float
    upper: float
    share: float
    of_time: float
    recording: str | None = None

    @property
    def density(self) -> float:
        """How much more of the error than of the time it holds."""
        return self.share - self.of_time

    def in_words(self, robot: Robot, joint: int) -> str:
        """Return where it lies along the motion of a robot's joint: `|dq| < 0.05 rad/s: 61 % of the excess...`."""
        symbol, unit = symbol_and_unit(self.what, robot, joint)
        if self.lower <= 0.0 and self.what in ("speed", "time_since_reversal"):
            where = f"{symbol} < {self.upper:.3g} {unit}"
        else:
            where = f"{self.lower:.3g} < {symbol} < {self.upper:.3g} {unit}"
        source = f" of {self.recording}" if self.recording else ""
        return f"{where}{source}: {100 * self.share:.0f} % of the excess in {100 * self.of_time:.0f} % of the time"


def symbol_and_unit(what: str, robot: Robot, joint: int) -> tuple[str, str]:
    """Return the symbol and the unit of a variable."""
    kind, _, other = what.partition(" of ")
    length = "m" if robot.prismatic[robot.joint_index(other) if other else joint] else "rad"
    of = f" of {other}" if other else ""
    symbols = {
        "position": (f"q{of}", length),
        "velocity": (f"dq{of}", f"{length}/s"),
        "speed": ("|dq|", f"{length}/s"),
        "acceleration": ("ddq", f"{length}/s^2"),
        "load": ("load torque", robot.torque_unit(joint)),
        "time_since_reversal": ("time since reversal", "s"),
        "time": ("t", "s"),
        "frequency": ("frequency", "Hz"),
    }
    return symbols[kind]


def densest(
    what: str, values: Sequence[Array], squared: Sequence[Array], used: Sequence[Mask], noise: Sequence[float]
) -> Region | None:
    """Return the stretch [lower, upper] that holds most error beyond its share of the time.

    squared [N]: squared residual in units of the noise; noise: what a used row of each recording has of it. The stretch
    maximises the sum over bins of (share of the excess - share of the time). None where the excess is no more than
    chance leaves.
    """
    x = np.concatenate([v[u] for v, u in zip(values, used, strict=True)])
    e = np.concatenate([s[u] - level for s, u, level in zip(squared, used, noise, strict=True)])
    total = float(e.sum())
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1)))
    chance = _CHANCE * np.sqrt(2.0 * sum(level**2 * u.sum() for level, u in zip(noise, used, strict=True)))
    if total <= chance or len(edges) < 3:
        return None
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    share = np.bincount(place, e, len(edges) - 1) / total
    time = np.bincount(place, minlength=len(edges) - 1) / len(x)
    first, last = _best_run(share - time)
    run = slice(first, last + 1)
    held = float(np.clip(share[run].sum(), 0.0, 1.0))
    lower = 0.0 if what == "speed" and first == 0 else float(edges[first])
    return Region(what, lower, float(edges[last + 1]), held, float(time[run].sum()))


def _best_run(score: Array) -> tuple[int, int]:
    """Return the first and last index of the run of largest sum."""
    best, place, total, start = -np.inf, (0, 0), 0.0, 0
    for index, value in enumerate(score):
        if total <= 0.0:
            total, start = 0.0, index
        total += value
        if total > best:
            best, place = total, (start, index)
    return place
