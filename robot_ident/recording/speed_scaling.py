"""A speed override stretches time: the same path, run through slower. Recognised by its shape."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array
from robot_ident.recording.average import average
from robot_ident.recording.clock import even_positions, read_clock
from robot_ident.recording.period import find_period
from robot_ident.recording.recording import Recording

_SAME = 5e-3  # share by which a period may be off without a word
_ALIKE = 0.05  # of a joint's rms motion: how far the measured path may stray from the commanded one
_OTHER = 0.3  # of it: another path


def speed_scale(recording: Recording, path: Callable[[Array], Array], base_frequency: float) -> float | None:
    """Return at which share of its speed a periodic motion was run, q(t) = path(s t); None where it is no such motion.

    path: positions [N, n] of the recording's joints at instants [N] s of the commanded motion, whose period is 1 /
    base_frequency. The measured mean period is shifted along the commanded one until they agree best. InputError where
    it has that period and is another path.
    """
    clock = read_clock(recording)
    period = find_period(even_positions(recording, clock), clock.dt)
    if period is None:
        return None
    scale = 1.0 / (period * clock.dt * base_frequency)
    same = abs(scale - 1.0) < _SAME
    try:
        _, mean = average(recording, clock, period)
    except InputError:
        return 1.0 if same else None
    commanded = path(np.arange(len(mean.q)) / len(mean.q) / base_frequency)
    apart = _apart(mean.q, commanded)
    if same and apart > _OTHER:
        raise InputError(
            f"{recording.source}: not the motion of the trajectory, though it has its period: the path differs by"
            f" {100 * apart:.0f} % of what its joints move (rms); name the trajectory that was played"
        )
    if same:
        return 1.0
    return scale if apart < _ALIKE else None


def _apart(measured: Array, commanded: Array) -> float:
    """Return by how much two periods [N, n] differ, over the rms motion, the start of either unknown."""
    a, b = (x - x.mean(axis=0) for x in (measured, commanded))
    match = np.fft.irfft(np.sum(np.fft.rfft(a, axis=0) * np.conj(np.fft.rfft(b, axis=0)), axis=1), len(a))
    rest = a - np.roll(b, int(np.argmax(match)), axis=0)
    size = np.sqrt(np.mean(commanded.var(axis=0)))
    return float(np.sqrt(np.mean(rest**2)) / size)
