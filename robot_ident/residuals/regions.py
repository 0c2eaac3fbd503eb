"""Where along a variable the excess error is packed most densely, and the residual beside its noise along it: mean and
rms in stretches of equal time, or bands of frequency.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.regression.evidence import Evidence
from robot_ident.regression.spectrum import Band
from robot_ident.residuals.curves import Variable
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


ALONG = ("position", "velocity", "acceleration", "load", "time_since_reversal", "time", "frequency")
_STRETCHES = 12


@dataclass(frozen=True)
class Stretch:
    """Of a variable from `lower` to `upper`: mean (None of a band) and rms of the residual, rms of its noise [Nm] (None
    where unknown).
    """

    lower: float
    upper: float
    mean: float | None
    rms: float
    noise_rms: float | None


@dataclass(frozen=True)
class Profile:
    """The stretches of one variable; recording: where it is the time of one."""

    what: str
    stretches: tuple[Stretch, ...]
    recording: str | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return it as `compare --json` prints it."""
        return {
            "what": self.what,
            "recording": self.recording,
            "stretches": [
                {"from": s.lower, "to": s.upper, "mean": s.mean, "rms": s.rms, "noise_rms": s.noise_rms}
                for s in self.stretches
            ],
        }


def profiles(
    evidence: Evidence, joint: int, seen: Sequence[Mapping[str, Variable]], bands: Sequence[Band], known: bool
) -> tuple[Profile, ...]:
    """Return the profiles of one joint over its own variables, the time of every recording, and frequency.

    seen: the variables of each trajectory; known: whether the noise is.
    """
    trajectories = evidence.trajectories
    used = [t.weight[:, joint] > 0 for t in trajectories]
    newton = [r[u, joint] / t.weight[u, joint] for r, u, t in zip(evidence.residual, used, trajectories, strict=True)]
    noise = [t.measured.averaged_variance[joint] if known else np.nan for t in trajectories]
    out = []
    for name in ALONG:
        if not all(name in one for one in seen):
            continue
        x = np.concatenate([one[name].signed(name)[u] for one, u in zip(seen, used, strict=True)])
        level = np.concatenate([np.full(len(r), v) for r, v in zip(newton, noise, strict=True)])
        out.append(Profile(name, _stretches(x, np.concatenate(newton), level)))
    for t, u, r, v in zip(trajectories, used, newton, noise, strict=True):
        time = np.asarray(np.flatnonzero(u) * t.measured.dt * t.measured.decimate, dtype=float)
        out.append(Profile("time", _stretches(time, r, np.full(len(r), v)), t.measured.source))
    if bands:
        out.append(Profile("frequency", _of_bands(bands, newton, evidence, joint, known)))
    return tuple(out)


def _stretches(x: Array, residual: Array, noise: Array) -> tuple[Stretch, ...]:
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _STRETCHES + 1))) if len(x) else np.zeros(0)
    if len(edges) < 2:
        return ()
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    rows = np.maximum(np.bincount(place, minlength=len(edges) - 1), 1)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(place, values, len(edges) - 1) / rows)

    figures = zip(edges[:-1], edges[1:], mean(residual), mean(residual**2), mean(noise), strict=True)
    return tuple(
        Stretch(float(a), float(b), float(m), float(s**0.5), float(v**0.5) if np.isfinite(v) else None)
        for a, b, m, s, v in figures
    )


def _of_bands(
    bands: Sequence[Band], newton: Sequence[Array], evidence: Evidence, joint: int, known: bool
) -> tuple[Stretch, ...]:
    """Return the rms that each band adds to the residual."""
    weight = np.concatenate([t.weight[:, joint] for t in evidence.trajectories])
    unit = float(np.mean(weight[weight > 0] ** 2)) * sum(len(r) for r in newton)
    top = max(0.5 / t.measured.dt for t in evidence.trajectories)
    return tuple(
        Stretch(b.lower, min(b.upper, top), None, (b.power / unit) ** 0.5, (b.noise / unit) ** 0.5 if known else None)
        for b in bands
    )
