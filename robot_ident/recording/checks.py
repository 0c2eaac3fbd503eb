"""Does a recording hold what was measured: samples of its own, of one robot, an effort of its own for each joint?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array, Mask
from robot_ident.recording.recording import Recording

_MOVES = 1e-3  # rad or m, from which on a joint has moved
_STEPS = 20  # of an encoder; within fewer a joint at rest may flicker
_STRAIGHT = 1e-6  # of a signal's range: no sensor measures three samples so exactly on one line
_MOSTLY = 0.5  # of the samples
_REGULAR = 0.9  # of the distances between the samples that were measured: alike, but for one sample
_LEAP = 0.01  # of the range of motion: a leap that no sample rate worth having leaves between two samples
_BACK = 0.1  # of a leap: what the sample after it is away from the one before it
_TOO_FAR = 5.0  # times the change from sample to sample that a joint exceeds in a hundredth of them
_AWAY = 5  # samples after which a reading that leapt is back
_FEW = 0.01  # share of samples that may be left out as readings that leapt
_LEAPS = 0.05  # share of samples that leap and come back


def check_samples(recording: Recording, *, motion_only: bool = False) -> None:
    """Raise InputError where samples are interpolated, come from two robots, or two joints share one effort.

    motion_only: efforts aren't used and may be anything.
    """
    _refuse_two_robots(recording)
    _refuse_interpolated(recording, {"positions": recording.q, **({} if motion_only else {"efforts": recording.tau})})
    if motion_only:
        return
    for one, other in combinations(range(len(recording.names)), 2):
        first, second = recording.tau[:, one], recording.tau[:, other]
        if np.ptp(first) > 0.0 and (np.array_equal(first, second) or np.array_equal(first, -second)):
            raise InputError(
                f"{recording.source}: the effort of {recording.names[other]} is that of {recording.names[one]} in every"
                " sample; one of them was never measured: name the joints of the efforts anew, or record again"
            )


def _refuse_two_robots(recording: Recording) -> None:
    """Raise InputError where positions leap to and fro: two publishers on one topic, each with its own robot."""
    count = recording.samples
    moving = [q for q in recording.q.T if np.ptp(q) > _MOVES and len(np.unique(q)) > _STEPS]
    if count < 20 or not moving:
        return
    leap, back = np.zeros((2, count - 2))
    for q in moving:
        leap += (np.diff(q[:-1]) / np.ptp(q)) ** 2
        back += ((q[2:] - q[:-2]) / np.ptp(q)) ** 2
    leap, back = np.sqrt(leap), np.sqrt(back)
    usual = float(np.median(np.minimum(leap, back)))
    leaps = (leap > _LEAP) & (back < _BACK * leap) & (leap > usual / _BACK)
    if leaps.mean() > _LEAPS:
        raise InputError(
            f"{recording.source}: positions leap to and fro in {int(leaps.sum())} of {count} samples: two publishers"
            " report joints of the same names on this topic; record each on a topic of its own, or stop one of them"
        )


def without_leaps(recording: Recording) -> Recording:
    """Return a recording without samples whose positions leap and are back within five samples: readings that were lost
    (zeros, say) or spoilt, which no joint has followed. A note names the first; more than a hundredth stay.
    """
    lost = np.zeros(recording.samples, dtype=bool)
    for q in recording.q.T:
        lost |= _leapt(q)
    if not lost.any() or lost.mean() > _FEW:
        return recording
    first = int(np.argmax(lost))
    joints = [name for name, q in zip(recording.names, recording.q.T, strict=True) if _leapt(q).any()]
    size = float(np.abs(np.diff(recording.q, axis=0)[first - 1]).max())
    note = (
        f"positions of {', '.join(joints)} leap by up to {size:.3g} and back in {int(lost.sum())} samples, first at"
        f" {recording.t[first]:.3f} s; these are left out: look for readings that the driver lost"
    )
    return replace(recording[~lost], notes=(*recording.notes, note))


def _leapt(q: Array) -> Mask:
    """Return which samples [N] of a joint's positions lie between a leap and one back."""
    out = np.zeros(len(q), dtype=bool)
    steps = np.diff(q)
    if len(steps) < 20:
        return out
    far = max(_TOO_FAR * float(np.percentile(np.abs(steps), 99.0)), _LEAP * float(np.ptp(q)))
    leaps = np.flatnonzero(np.abs(steps) > far)
    for away, back in zip(leaps[:-1], leaps[1:], strict=True):
        if back - away <= _AWAY and abs(q[back + 1] - q[away]) < _BACK * abs(steps[away]):
            out[away + 1 : back + 1] = True
    return out


def _refuse_interpolated(recording: Recording, signals: Mapping[str, Array]) -> None:
    """Raise InputError where samples lie on straight lines between every so many of them."""
    for what, signal in signals.items():
        bends = _bends(recording.t, signal)
        if bends is None:
            continue
        rate = (recording.samples - 1) / recording.duration
        raise InputError(
            f"{recording.source}: the {what} lie on straight lines between {int(bends.sum())} of"
            f" {recording.samples} samples: they were interpolated from about {bends.sum() / recording.duration:.3g} Hz"
            f" to {rate:.3g} Hz, and their accelerations are not the robot's; give the samples as they were measured"
        )


def _bends(t: Array, signal: Array) -> Mask | None:
    """Return at which samples [N] a signal [N, n] bends, where most others lie between them on straight lines; None
    where it is no such signal.
    """
    columns = [column for column in signal.T if np.ptp(column) > _MOVES]
    if len(t) < 50 or not columns:
        return None
    steps = np.diff(t)
    shorter = np.minimum(steps[1:], steps[:-1])
    straight, moving = np.ones((2, len(t) - 2), dtype=bool)
    for column in columns:
        change = np.diff(column) / np.ptp(column)
        straight &= np.abs(np.diff(change / steps)) * shorter < _STRAIGHT
        moving &= np.abs(change[1:]) > 10.0 * _STRAIGHT
    if straight[moving].sum() <= _MOSTLY * len(straight):
        return None
    apart = np.diff(np.flatnonzero(~straight))
    apart = apart[apart > 1]  # a measured sample between two of the grid bends at both
    if len(apart) < 10 or np.mean(np.abs(apart - np.median(apart)) <= 1.0) < _REGULAR:
        return None
    return np.concatenate([[False], ~straight & np.concatenate([[True], straight[:-1]]), [False]])
