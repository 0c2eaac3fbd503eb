"""The period of a recording and its steady part, found from the positions alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from robot_ident.errors import InputError
from robot_ident.recording.clock import roughness
from robot_ident.signals.motion import Array, Mask

_COARSE = 1500  # samples of the coarse search
_STRETCH = 1 << 17  # samples of a long recording that are searched at first, then twice as many
_REPEATS = 1e-3  # of the variance: the largest median difference that counts as repeating
_RETURN = 0.05  # a dip lies this far below the largest difference at shorter lags
_OVERLAP = 0.2  # of the samples in motion must overlap at a lag
_REST = 0.1  # of its top speed: a joint slower than this is nearly at rest
AT_REST = 1e-3  # rad or m: a joint that strays less stands still
_LITTLE = 0.01  # rad or m: a joint that strays less may be held
_ROUGH = 0.03  # of what a joint strays: with more noise from sample to sample it can't repeat to `_REPEATS`
_KEPT = 64  # periods that are known by the content of their positions: a recording is processed many times
_CHANCE = 1e-3  # of taking the scatter from period to period for another motion, once in a recording
_SMOOTH = 0.04  # share of a period over which the mismatch of successive periods is averaged


@dataclass(frozen=True)
class Steady:
    """The steady part of a recording on the even grid: M whole periods of `period` samples up to sample `last`."""

    period: float
    periods: int
    last: int


def find_period(q: Array, dt: float) -> float | None:
    """Return the period [samples] of positions q [N, n] on an even grid, or None when they don't repeat.

    The median over time of the squared difference at a lag is blind to transients: its dips on a coarse grid are
    candidates, sharpened on the full one; the shortest that repeats as well as the best is the period. Of it, the
    smallest multiple counts after which the joints that hardly move are where they were, too. A long recording is
    searched from its first motion on as far as it takes to find a lag at which all of it repeats. The same positions
    are searched once.
    """
    key = (q.shape, q.dtype.str, dt, sha256(np.ascontiguousarray(q)).digest())
    found = _known.get(key)
    if found is None:
        found = (_find_period(q, dt),)
        if len(_known) >= _KEPT:
            _known.clear()
        _known[key] = found
    return found[0]


_known: dict[object, tuple[float | None]] = {}


def _find_period(q: Array, dt: float) -> float | None:
    moving = _moving(q)
    lag = _shortest_of(q, moving)
    if lag is None:
        return None
    still = q[:, ~moving]
    stray = np.maximum(4.0 * roughness(still), AT_REST) ** 2
    for whole in range(lag, len(q) // 2 + 3, lag):
        if np.all(np.median((still[whole:] - still[:-whole]) ** 2, axis=0) <= stray):
            return refine_period(q, float(whole), dt)
    return None


def _shortest_of(q: Array, moving: Mask) -> int | None:
    """Return the shortest lag [samples] at which the joints that move repeat in a first stretch and in all of q."""
    columns = _columns(q, moving)
    if len(q) <= 2 * _STRETCH:
        return _shortest(columns)
    units = [float(column.std()) for column in columns]
    awake = _awake(columns)
    first, length = int(np.argmax(awake)), _STRETCH
    while length < len(q) - first:
        part = q[first : first + length]
        there = moving & _moving(part)
        lag = _shortest(_columns(part, there)) if there.any() else None
        if lag is not None and _median_difference(columns, awake, lag, units) <= _REPEATS:
            return lag
        length *= 2
    return _shortest(columns)


def _columns(q: Array, joints: Mask) -> list[Array]:
    """Return the positions [N] of some joints, no copies of them: a recording may be long."""
    return [q[:, joint] for joint in np.flatnonzero(joints)]


def _shortest(columns: Sequence[Array]) -> int | None:
    """Return the shortest lag [samples] at which joints that move repeat as well as at any, None where they don't."""
    columns = [(column - column.mean()) / column.std() for column in columns]
    awake = _awake(columns)
    stride = max(1, int(awake.sum()) // _COARSE)
    lags = _dips([column[::stride] for column in columns], awake[::stride]) * stride
    if not len(lags):
        return None
    sharp = [_sharpen(columns, awake, int(lag)) for lag in lags]
    median = np.array([_median_difference(columns, awake, lag) if lag >= 4 else np.inf for lag in sharp])
    if median.min() > _REPEATS:
        return None
    return min(lag for lag, value in zip(sharp, median, strict=True) if value <= 9.0 * median.min() + 1e-9)


def turning_on(q: Array, dt: float, joints: Sequence[str]) -> str:
    """Return a line where positions q [N, n] of joints repeat but for whole turns of some, which go on turning; empty
    where they don't. Such a joint has no mean position over a period.
    """
    far = [joint for joint in range(len(joints)) if np.ptp(q[:, joint]) > 2.0 * np.pi]
    if not far:
        return ""
    period = find_period(np.hstack([np.delete(q, far, axis=1), np.cos(q[:, far]), np.sin(q[:, far])]), dt)
    if period is None:
        return ""
    lag = round(period)
    turns = np.rint(np.median(q[lag:, far] - q[:-lag, far], axis=0) / (2.0 * np.pi))
    on = [f"{joints[joint]} ({number:+.0f})" for joint, number in zip(far, turns, strict=True) if number]
    if not on:
        return ""
    return (
        f"the motion repeats every {period * dt:.4g} s but for whole turns of {', '.join(on)}: periods of a joint that"
        " goes on turning are not averaged; have it turn back within each period for a noise floor"
    )


def refine_period(q: Array, period: float, dt: float) -> float:
    """Return the period [samples] to a small part of a sample, from the shift between distant periods over the steady
    samples; lags of 1, 2, 4... periods, each refining the last.
    """
    columns = _columns(q, _moving(q))
    weights = [1.0 / max(float(np.gradient(column).std()), 1e-12) ** 2 for column in columns]
    awake = _awake(columns)
    repeats, least = 1, np.inf
    while (repeats + 0.5) * period < len(q):
        lag = round(repeats * period)
        rows = awake[lag:] & awake[:-lag]
        if rows.sum() < 10:
            break
        gap = np.zeros(len(rows))
        for weight, column in zip(weights, columns, strict=True):
            gap += weight * (column[lag:] - column[:-lag]) ** 2
        quiet = float(np.percentile(gap[rows], 30.0))
        if quiet > 25.0 * least + 1e-9:  # beyond the periods that there are
            break
        least = min(least, quiet)
        calm = rows & (gap <= 4.0 * quiet + 1e-12)
        shift = _shift(columns, weights, lag, calm)
        if abs(shift) < 0.5 * period:
            period = (lag + shift) / repeats
        repeats *= 2
    nearest = round(period)
    return float(nearest) if abs(period - nearest) * (len(q) / period) < 0.1 else period


def steady_part(q: Array, period: float, step: Array, source: str) -> Steady:
    """Return the longest part of positions q [N, n] that repeats with `period` [samples].

    step [n]: differences of the noise's size. Raises InputError when it holds fewer than two periods.
    """
    moving = _moving(q)
    columns = _columns(q, moving)
    lag = round(period)
    if len(q) < lag + 4:
        raise InputError(f"{source}: {len(q) / period:.1f} periods; at least 2 are needed where periods are averaged")
    shift = lag - period
    window = max(5, int(_SMOOTH * period))
    kernel = np.ones(window) / window
    awake = _awake(columns)
    rows = awake[lag:] | awake[:-lag]
    total = np.concatenate([[0], np.cumsum(awake)])
    good = (total[lag:] - total[:-lag] > 0.1 * lag)[: len(rows)]  # from where on something moves in a tenth of a period
    for column, rough in zip(columns, step[moving], strict=True):
        gap = (column[lag:] - column[:-lag] - shift * np.gradient(column)[:-lag]) ** 2
        smooth = np.convolve(gap, kernel, mode="same")
        # the noise around each sample: where samples are off the clock it grows with speed
        local = np.convolve(np.concatenate([np.diff(column, n=3) ** 2 / 20.0, np.zeros(3)]), kernel, mode="same")
        noise = np.maximum(rough**2, local[: len(smooth)])
        usual = _largest_by_chance(smooth[rows], len(rows) / window * len(columns))
        # tremor of 1e-4 of the motion still counts as repeating
        good &= smooth <= usual + 4.0 * noise + (1e-4 * column.std()) ** 2
    first, end = longest_run(good)
    last = end - 1 + lag
    periods = int((last - first + 1 + 1e-6 * period) / period)
    if periods < 2:
        found = (last - first + 1) / period
        raise InputError(
            f"{source}: only {found:.1f} steady periods of {period:.0f} samples found;"
            " at least 2 are needed where periods are averaged"
        )
    return Steady(period, periods, last)


def _largest_by_chance(smooth: Array, windows: float) -> float:
    """Return the mean square mismatch that one in `windows` of them reaches by chance, at least (4 sigma)^2 over the
    calm quarter.

    A window of noise from sample to sample is a mean of many squares; what friction makes of each period is slow, so
    that a window holds few, nu. The ratio of the quartiles of chi-square with nu degrees of freedom tells how many,
    that of the lower one and the median where more than a quarter is no scatter.
    """
    from scipy.special import chdtri

    quarter, *above = np.percentile(smooth, (25.0, 75.0, 50.0)) + 1e-300
    dof = np.arange(1.0, 33.0)
    for upper, tail in zip(above, (0.25, 0.5), strict=True):
        ratios = chdtri(dof, tail) / chdtri(dof, 0.75)
        nu = float(np.interp(-upper / quarter, -ratios, dof))
        if upper <= ratios[0] * quarter:
            break
    largest = chdtri(nu, _CHANCE / windows) / chdtri(nu, 0.75)
    return float(quarter) * max(16.0, float(largest))


def _moving(q: Array) -> Mask:
    """Return which joints of positions q [N, n] move: one that is held shows noise or creeps, and repeats with no
    period. All that are not quite constant where none moves by more.
    """
    scale = q.std(axis=0)
    some = scale > 1e-9 * max(1.0, float(scale.max()))
    moving = some & (np.ptp(q, axis=0) >= _LITTLE) & (roughness(q) < _ROUGH * scale)
    return np.asarray(moving if moving.any() else some)


def runs(there: Mask) -> NDArray[np.int64]:
    """Return where each run of samples that are `there` [N] begins, and the first sample after it [K, 2]."""
    return np.flatnonzero(np.diff(np.concatenate([[0], there.astype(np.int8), [0]]))).reshape(-1, 2)


def longest_run(there: Mask) -> tuple[int, int]:
    """Return where the longest of `runs` begins, and the first sample after it; 0, 0 where there is none."""
    found = runs(there)
    if not len(found):
        return 0, 0
    first, end = found[np.argmax(found[:, 1] - found[:, 0])]
    return int(first), int(end)


def _dips(columns: Sequence[Array], awake: Mask) -> np.ndarray:
    """Return the lags at which the median difference dips, the deepest 30, shortest first."""
    lags = np.arange(3, len(awake) // 2 + 2)
    if len(lags) < 3:
        return np.empty(0, dtype=int)
    curve = np.array([_median_difference(columns, awake, int(lag)) for lag in lags])
    curve = np.append(curve, np.inf)
    dips = 1 + np.flatnonzero((curve[1:-1] <= curve[:-2]) & (curve[1:-1] <= curve[2:]))
    left = np.maximum.accumulate(curve[:-1])
    dips = dips[curve[dips] < _RETURN * left[dips]]  # what creeps away never returned
    dips = dips[np.argsort(curve[dips], kind="stable")[:30]]
    return np.sort(lags[dips])


def _sharpen(columns: Sequence[Array], awake: Mask, lag: int) -> int:
    """Return the lag nearby at which they repeat best, by their shift over the calm half."""
    for _ in range(3):
        if not 1 <= lag < len(awake):
            return lag
        size = _squared_difference(columns, lag)
        rows = awake[lag:] & awake[:-lag]
        if not rows.any():
            return lag
        calm = rows & (size <= np.median(size[rows]))
        lag += round(_shift(columns, [1.0] * len(columns), lag, calm))
    return lag


def _shift(columns: Sequence[Array], weights: Sequence[float], lag: int, calm: Mask) -> float:
    """Return by how much more than `lag` [samples] columns repeat, over some rows: - sum dx (x(t + lag) - x(t)) / sum
    dx^2, each column by its weight.
    """
    moved, size = 0.0, 0.0
    for weight, column in zip(weights, columns, strict=True):
        slope = np.gradient(column)
        mean = 0.5 * (slope[lag:] + slope[:-lag])[calm]
        moved += weight * float(mean @ (column[lag:] - column[:-lag])[calm])
        size += weight * float(mean @ mean)
    return -moved / max(size, 1e-300)


def _median_difference(columns: Sequence[Array], awake: Mask, lag: int, units: Sequence[float] | None = None) -> float:
    """Return the median squared difference at a lag over instants that both lie in motion; inf where they are few.

    units: of the columns, None where they are 1.
    """
    rows = awake[lag:] & awake[:-lag]
    if rows.sum() < max(10.0, _OVERLAP * awake.sum()):
        return np.inf
    return float(np.median(_squared_difference(columns, lag, units)[rows] / len(columns)) / 2.0)


def _squared_difference(columns: Sequence[Array], lag: int, units: Sequence[float] | None = None) -> Array:
    """Return |x(t + lag) - x(t)|^2 [N - lag] over the joints."""
    total = np.zeros(len(columns[0]) - lag)
    for column, unit in zip(columns, units or [1.0] * len(columns), strict=True):
        total += ((column[lag:] - column[:-lag]) / unit) ** 2
    return total


def _awake(columns: Sequence[Array]) -> Mask:
    """Return at which samples a joint moves: rest repeats with any period and tells nothing."""
    awake = np.zeros(len(columns[0]), dtype=bool)
    for column in columns:
        speed = np.abs(np.gradient(column))
        awake |= (speed > _REST * np.percentile(speed, 98.0)) & (speed > 0.0)
    return awake
