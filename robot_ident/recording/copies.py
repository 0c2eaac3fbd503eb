"""Recordings that tell no more than another: copies of it, and repetitions of its motion."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording

_ONE_NOISE = 0.25  # of the variance by which two measurements differ: two of one noise differ by less
_SAME_ROWS = 0.3  # share of the rows of a recording that stand in another one to the last digit
_ALIKE = 0.05  # of a motion's rms, by which repetitions of it may differ


def refuse_copies(measurements: Sequence[Measurement]) -> None:
    """Raise InputError where two measurements hold the same torques of one motion, as a recording under two names does.

    To the last digit; or, rounded or trimmed, their noise: what is measured again differs by 2 sigma^2 in the mean.
    A torque that was commanded may be the same on different motions.
    """
    for one, other in combinations(measurements, 2):
        if one is other or (_of_one_torque(one, other) and _of_one_place(one, other)):
            raise InputError(
                f"{other.source} holds the samples of {one.source}: a copy of it, or a simulation of the"
                " same motion without noise; give every one once, since the noise of both would be counted as"
                " independent, and what is kept aside as not seen"
            )


def _of_one_torque(one: Measurement, other: Measurement) -> bool:
    return bool(np.array_equal(one.torque, other.torque, equal_nan=True)) or _of_one_noise(one, other)


def _of_one_place(one: Measurement, other: Measurement) -> bool:
    """Return whether two measurements go over the same positions, instant by instant or shifted by part of a period."""
    a, b = one.motion.q, other.motion.q
    if a.shape == b.shape and np.all(np.abs(a - b).max(axis=0) <= _ALIKE * np.maximum(a.std(axis=0), 1e-9)):
        return True
    return _repeats(one, other)


def _of_one_noise(one: Measurement, other: Measurement) -> bool:
    """Return whether two averaged periods differ by far less than their noise, wherever in a period each began.

    min over shifts s of mean_t (a_j(t) - b_j(t - s))^2 / sigma_j^2, from the cross spectrum.
    """
    if one.base_frequency is None or other.base_frequency is None or one.torque.shape != other.torque.shape:
        return False
    sigma = np.sqrt(one.torque_variance / one.averages + other.torque_variance / other.averages)
    if not np.all(np.isfinite(sigma) & (sigma > 0.0)):
        return False
    a, b = (np.nan_to_num(measured.torque / sigma) for measured in (one, other))
    lines = (np.fft.rfft(a, axis=0) * np.fft.rfft(b, axis=0).conj()).sum(axis=1)
    apart = np.sum(a**2) + np.sum(b**2) - 2.0 * np.fft.irfft(lines, len(a)).max()
    return bool(apart < _ONE_NOISE * a.size)


def refuse_same_rows(recordings: Sequence[Recording]) -> None:
    """Raise InputError where one recording holds rows of another to the last digit: every second of them, say."""
    for one, other in combinations(recordings, 2):
        if one.names != other.names:
            continue
        shorter, longer = sorted((other, one), key=lambda recording: recording.samples)
        rows = _moving_rows(shorter)
        if len(rows) and np.isin(rows, _moving_rows(longer)).mean() > _SAME_ROWS:
            raise InputError(
                f"{shorter.source} holds the samples of {longer.source} to the last digit: a copy of it, or a part of"
                " one; give every one once, since the noise of both would be counted as independent"
            )


def _moving_rows(recording: Recording) -> Array:
    """Return the rows of positions and efforts as single values, those that equal their predecessor left out."""
    rows = np.ascontiguousarray(np.hstack([recording.q, recording.tau]))
    fresh = np.concatenate([[True], np.any(np.diff(rows, axis=0) != 0.0, axis=1)])
    values: Array = rows[fresh].view([("", rows.dtype)] * rows.shape[1]).reshape(-1)
    return values


def of_one_motion(measurements: Sequence[Measurement]) -> bool:
    """Return whether all measurements are of periods of one motion, wherever in it each began."""
    first, *others = measurements
    return all(_repeats(first, other) for other in others)


def _repeats(one: Measurement, other: Measurement) -> bool:
    """Return whether two periodic motions are the same but for a shift of time and how finely they were sampled.

    max over shifts s of sum_j <a_j(t), b_j(t - s)> for joints in units of their rms, from the cross spectrum; with it
    the mean square of the difference.
    """
    if one.base_frequency is None or other.base_frequency is None:
        return False
    if abs(one.base_frequency / other.base_frequency - 1.0) > _ALIKE:
        return False
    samples = min(len(one.motion.q), len(other.motion.q))
    unit = np.maximum(one.motion.q.std(axis=0), 1e-12)
    a, b = (_lines(measured.motion.q / unit, samples) for measured in (one, other))
    along: Array = np.fft.irfft((a * b.conj()).sum(axis=1), samples)
    whole: Array = np.fft.irfft((a * a.conj() + b * b.conj()).sum(axis=1), samples)
    return bool(whole[0] - 2.0 * along.max() <= _ALIKE**2 * samples * len(unit))


def _lines(x: Array, samples: int) -> np.ndarray:
    """Return the complex Fourier lines of a period x [N, n] as if it had been sampled less finely."""
    return np.asarray(np.fft.rfft(x, axis=0)[: samples // 2 + 1] * (samples / len(x)))
