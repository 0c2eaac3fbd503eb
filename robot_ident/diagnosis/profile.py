"""The residual beside its noise along a variable: mean and rms in stretches of equal time, or bands of frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.diagnosis.curves import Variable
from robot_ident.diagnosis.evidence import Evidence
from robot_ident.diagnosis.spectrum import Band
from robot_ident.signals.motion import Array

ALONG = ("position", "velocity", "acceleration", "load", "time_since_reversal", "time", "frequency")
_BINS = 12


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
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, _BINS + 1))) if len(x) else np.zeros(0)
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
