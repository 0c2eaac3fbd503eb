"""What a recording holds, before any robot is named: rate, gaps, period, noise, range of motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array
from robot_ident.recording.average import Average, average
from robot_ident.recording.clock import Clock, even_positions, read_clock
from robot_ident.recording.period import find_period
from robot_ident.recording.recording import Recording


@dataclass(frozen=True)
class Summary:
    """Facts about a recording. Joint arrays [n]: range of q rad, top speed rad/s, largest torque Nm; noise variances
    of one sample or None.
    """

    joints: tuple[str, ...]
    samples: int
    duration: float
    rate: float
    missing: int
    period: float | None
    periods: int | None
    lower: Array
    upper: Array
    top_speed: Array
    top_torque: Array
    torque_variance: Array | None
    position_variance: Array | None
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data, joints by name."""
        noise_tau, noise_q = self.torque_variance, self.position_variance
        return {
            "samples": self.samples,
            "duration": self.duration,
            "sample_rate": self.rate,
            "missing_samples": self.missing,
            "period": self.period,
            "periods": self.periods,
            "joints": [
                {
                    "name": name,
                    "lowest_position": float(self.lower[k]),
                    "highest_position": float(self.upper[k]),
                    "top_speed": float(self.top_speed[k]),
                    "top_torque": float(self.top_torque[k]),
                    "torque_variance": None if noise_tau is None else float(noise_tau[k]),
                    "position_variance": None if noise_q is None else float(noise_q[k]),
                }
                for k, name in enumerate(self.joints)
            ],
            "notes": list(self.notes),
        }


def summarise(recording: Recording) -> Summary:
    """Return the facts about a recording; its noise where it repeats."""
    clock = read_clock(recording)
    q = even_positions(recording, clock)
    period, mean, periods, notes = find_period(q, clock.dt), None, None, [*recording.notes, *clock.notes]
    if period is None:
        notes.append("no period found: one pass, or fewer than 2 periods")
    else:
        mean, periods = _mean_period(recording, clock, period, notes)
    step = max(1, round(0.02 / clock.dt))
    speed = np.abs(q[step:] - q[:-step]).max(axis=0) / (step * clock.dt) if len(q) > step else np.zeros(q.shape[1])
    return Summary(
        joints=recording.names,
        samples=recording.samples,
        duration=recording.duration,
        rate=1.0 / clock.dt,
        missing=clock.missing,
        period=None if period is None else period * clock.dt,
        periods=periods,
        lower=recording.q.min(axis=0),
        upper=recording.q.max(axis=0),
        top_speed=speed,
        top_torque=np.abs(recording.tau).max(axis=0),
        torque_variance=None if mean is None else mean.tau_variance,
        position_variance=None if mean is None else mean.q_variance,
        notes=tuple(notes),
    )


def _mean_period(
    recording: Recording, clock: Clock, period: float, notes: list[str]
) -> tuple[Average | None, int | None]:
    try:
        steady, mean = average(recording, clock, period)
    except InputError as error:
        notes.append(str(error))
        return None, None
    return mean, steady.periods
