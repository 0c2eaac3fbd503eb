"""What a recording holds, before any robot is named: rate, gaps, period, noise, range of motion.

A speed override stretches time: the same path, run through slower, is recognised by its shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.averaging import average, cycle_notes, cycles_instead
from robot_ident.recording.checks import silent_efforts, silent_note, without_leaps
from robot_ident.recording.clock import Stamps, even_positions, rate_note, read_clock
from robot_ident.recording.cycles import Cycles
from robot_ident.recording.frozen import find_frozen
from robot_ident.recording.period import find_period, turning_on
from robot_ident.recording.recording import Recording
from robot_ident.recording.repairs import repaired
from robot_ident.recording.resolution import position_step
from robot_ident.recording.saturation import find_clipped
from robot_ident.signals.motion import Array


@dataclass(frozen=True)
class Summary:
    """Facts about a recording: its periods, or the cycles that repeat, or neither.

    Joint arrays [n]: range of q rad, top speed rad/s, largest torque Nm; noise variances of one sample or None; the
    step rad on which positions stand, 0 where none shows.
    """

    joints: tuple[str, ...]
    samples: int
    duration: float
    rate: float
    missing: int
    period: float | None
    periods: int | None
    cycles: Cycles | None
    stamps: Stamps
    lower: Array
    upper: Array
    top_speed: Array
    top_torque: Array
    torque_variance: Array | None
    position_variance: Array | None
    position_step: Array
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
            "cycles": None if self.cycles is None else self.cycles.to_dict(),
            "clock": self.stamps.to_dict(),
            "joints": [
                {
                    "name": name,
                    "lowest_position": float(self.lower[k]),
                    "highest_position": float(self.upper[k]),
                    "top_speed": float(self.top_speed[k]),
                    "top_torque": float(self.top_torque[k]),
                    "torque_variance": None if noise_tau is None else float(noise_tau[k]),
                    "position_variance": None if noise_q is None else float(noise_q[k]),
                    "position_step": float(self.position_step[k]) or None,
                }
                for k, name in enumerate(self.joints)
            ],
            "notes": list(self.notes),
        }


def summarise(recording: Recording) -> Summary:
    """Return the facts about a recording; its noise where it repeats."""
    recording = without_leaps(repaired(recording))
    clock = read_clock(recording)
    q = even_positions(recording, clock)
    period, mean, periods, notes = find_period(q, clock.dt), None, None, [*recording.notes, *clock.notes]
    cycles, trouble = None, ""
    said = (rate_note(q, clock.dt, recording.names), silent_note(silent_efforts(recording)))
    notes += [
        line for line in (*said, *find_clipped(recording)[1].values(), *find_frozen(recording)[1].values()) if line
    ]
    endless = turning_on(q, clock.dt, recording.names)
    if endless:
        period = None
    if period is not None:
        try:
            steady, mean = average(recording, clock, period)
            periods = steady.periods
        except InputError as error:
            trouble = str(error)
    found = None if endless else cycles_instead(recording, clock, q, mean)
    if found is not None:
        (cycles, mean), period, periods, trouble = found, None, None, ""
    if trouble:
        notes.append(trouble)
    if cycles is not None and mean is not None:
        notes += cycle_notes(cycles, mean)
    elif mean is None:
        notes.append(
            endless
            or "nothing repeats: one pass, or fewer than 2 periods; it tells no noise floor, so that no model of it can"
            " be called adequate (repeat the motion 8 times or more)"
        )
    step = max(1, round(0.02 / clock.dt))
    speed = np.array([np.abs(one[step:] - one[:-step]).max(initial=0.0) / (step * clock.dt) for one in q.T])
    return Summary(
        joints=recording.names,
        samples=recording.samples,
        duration=recording.duration,
        rate=1.0 / clock.dt,
        missing=clock.missing,
        period=None if period is None else period * clock.dt,
        periods=periods,
        cycles=cycles,
        stamps=clock.stamps,
        lower=recording.q.min(axis=0),
        upper=recording.q.max(axis=0),
        top_speed=speed,
        top_torque=np.maximum(recording.tau.max(axis=0), -recording.tau.min(axis=0)),
        torque_variance=None if mean is None else mean.tau_variance,
        position_variance=None if mean is None else mean.q_variance,
        position_step=position_step(recording.q),
        notes=tuple(notes),
    )


_SAME = 5e-3  # share by which a period may be off without a word
_ALIKE = 0.05  # of a joint's rms motion: how far the measured path may stray from the commanded one
_OTHER = 0.3  # of it: another path
_PLACED = 0.05  # of a joint's commanded range: farther off, its zero or its scale is another than commanded


def mean_path(recording: Recording) -> tuple[float | None, Array | None]:
    """Return the period [s] of a recording and its mean positions [N, n] over one; None where nothing repeats."""
    clock = read_clock(recording)
    period = find_period(even_positions(recording, clock), clock.dt)
    if period is None:
        return None, None
    try:
        return period * clock.dt, average(recording, clock, period)[1].q
    except InputError:
        return period * clock.dt, None


def speed_scale(
    source: str, mean: tuple[float | None, Array | None], path: Callable[[Array], Array], base_frequency: float
) -> float | None:
    """Return at which share of its speed a periodic motion was run, q(t) = path(s t); None where it is no such motion.

    path: positions [N, n] of the recording's joints at instants [N] s of the commanded motion, whose period is 1 /
    base_frequency. The measured mean period is shifted along the commanded one until they agree best. InputError where
    it has that period and is another path. source: the recording; mean: what `mean_path` says of it.
    """
    period, q = mean
    if period is None:
        return None
    scale = 1.0 / (period * base_frequency)
    same = abs(scale - 1.0) < _SAME
    if q is None:
        return 1.0 if same else None
    apart = _apart(q, path(np.arange(len(q)) / len(q) / base_frequency))
    if same and apart > _OTHER:
        raise InputError(
            f"{source}: not the motion of the trajectory, though it has its period: the path differs by"
            f" {100 * apart:.0f} % of what its joints move (rms); name the trajectory that was played"
        )
    if same:
        return 1.0
    return scale if apart < _ALIKE else None


def path_notes(
    joints: Sequence[str], q: Array | None, path: Callable[[Array], Array], base_frequency: float, file: str
) -> tuple[str, ...]:
    """Return a line for every joint of a periodic motion that moves farther than it was commanded, or elsewhere: its
    encoder's scale or zero is another than the robot's that played it. q: their mean positions, as `mean_path` gives
    them; path: as `speed_scale` takes it; file: its name.
    """
    commanded = None if q is None else path(np.arange(len(q)) / len(q) / base_frequency)
    if q is None or commanded is None or _apart(q, commanded) > _OTHER:
        return ()
    out = []
    for name, moved, wanted in zip(joints, q.T, commanded.T, strict=True):
        reach = float(np.ptp(wanted))
        if reach == 0.0:
            continue
        scale = float(np.std(moved) / np.std(wanted))
        off = float(moved.mean() - wanted.mean())
        if abs(scale - 1.0) > _PLACED:
            out.append(
                f"{name} moves {scale:.3g} times as far as {file} commands: its position's scale"
                " (encoder, gear ratio, unit) is wrong, or the drive doesn't follow"
            )
        elif abs(off) > _PLACED * reach:
            out.append(
                f"{name} is {off:+.3g} away from where {file} commands it: its zero is another than"
                " the URDF's, or the drive doesn't follow"
            )
    return tuple(out)


def _apart(measured: Array, commanded: Array) -> float:
    """Return by how much two periods [N, n] differ, over the rms motion, the start of either unknown."""
    a, b = (x - x.mean(axis=0) for x in (measured, commanded))
    match = np.fft.irfft(np.sum(np.fft.rfft(a, axis=0) * np.conj(np.fft.rfft(b, axis=0)), axis=1), len(a))
    rest = a - np.roll(b, int(np.argmax(match)), axis=0)
    size = np.sqrt(np.mean(commanded.var(axis=0)))
    return float(np.sqrt(np.mean(rest**2)) / size)
