"""The mean period of a recording: samples of the same phase averaged, or Fourier lines fitted to them; the mean cycle
of production data, its moves aligned to a part of a sample.

Periods that are not like the others are left out: somebody leant on the arm, a message burst was lost, a contact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_ident.recording.clock import Clock, even_positions, even_samples, roughness
from robot_ident.recording.cycles import Cycles, find_cycles
from robot_ident.recording.noise_spectrum import OffClock, mean_of_periods, off_clock
from robot_ident.recording.period import Steady, steady_part
from robot_ident.recording.recording import Recording
from robot_ident.signals.fourier import Lines, evaluate, fit_lines
from robot_ident.signals.motion import Array

_BLOCKS = 25  # stretches of a period that are judged one by one
_RATIO = {"torque": 4.0, "position": 25.0}  # of the usual scatter, in power: less does no harm to the average
_SPREAD = 8.0  # robust standard deviations of the logarithm
_LEAST = 4  # periods, below which no majority says what is usual
_SHARE = 0.25  # of the periods, above which they are not outliers but another state of the robot


def outlying_periods(periods: Array, what: str = "torque") -> list[int]:
    """Return which of the periods [M, N, n] (gaps nan) scatter far more about the median period than is usual.

    The mean square of each stretch, period and joint is compared with its median over the periods; an outlier exceeds
    it by a factor (4 for torque) and by 8 robust standard deviations of the logarithm.
    """
    count, samples, n = periods.shape
    if count < _LEAST or samples < 4 * _BLOCKS:
        return []
    edges = np.linspace(0, samples, _BLOCKS + 1).astype(int)
    found = np.full((count, _BLOCKS, n), np.nan)
    for block, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        piece = periods[:, first:last] - np.nanmedian(periods[:, first:last], axis=0)
        present = np.isfinite(piece).sum(axis=1)
        energy = np.nansum(piece**2, axis=1)
        found[:, block] = np.where(present >= 4, energy / np.maximum(present, 1), np.nan)
    usual = np.nanmedian(found, axis=0)
    ratio = found / np.where(usual > 0, usual, np.inf)
    logarithm = np.log(np.maximum(ratio, 1e-12))
    spread = 1.4826 * np.nanmedian(np.abs(logarithm[ratio > 0])) if np.any(ratio > 0) else 0.0
    bound = max(np.log(_RATIO[what]), _SPREAD * spread)
    outlying = np.flatnonzero(np.nanmax(np.nan_to_num(logarithm, nan=-np.inf), axis=(1, 2)) > bound)
    return [int(m) for m in outlying] if len(outlying) <= _SHARE * count else []


_LARGEST_FIT = 400  # lines of the least-squares fit where the samples don't fall on a grid
_FINER = 4  # points per sample at most, of a grid that holds few lines: on a coarser one jumps of friction would alias
FINE = 20.0  # rows in a period of a band's edge: what the jumps of friction alias into the band stays below a percent


@dataclass(frozen=True)
class Average:
    """Mean period on an even grid [N, n], per-sample variance [n] with its degrees of freedom, and the periods one by
    one.

    averages: how many samples' noise is averaged in each value. scatter [M, N, n]: periods of the torque, or of what is
    left of it after the fit, from which the noise is judged. lines: where only so many lines of the torque are known.
    after: samples that follow the last period. left_out: numbers of periods unlike the others, from 1.
    """

    q: Array
    tau: Array
    q_variance: Array
    tau_variance: Array
    dof: float
    averages: float
    periods_of_tau: Array | None
    scatter: Array
    note: str = ""
    lines: int | None = None
    after: int = 0
    left_out: tuple[int, ...] = ()
    off_clock: OffClock | None = None

    @property
    def periods(self) -> int:
        """How many periods were averaged."""
        return len(self.scatter)


def average(recording: Recording, clock: Clock, period: float) -> tuple[Steady, Average]:
    """Return the steady part of a recording and its mean period; InputError when fewer than two periods are steady."""
    grid_q = even_positions(recording, clock)
    steady = steady_part(grid_q, period, roughness(grid_q), recording.source)
    samples, mean = round(period), None
    if clock.index is not None and abs(period - samples) * steady.periods < 0.1:
        mean = _fold(recording, clock.index, steady, samples)
    return steady, replace(mean or _fit(recording, clock, steady), after=len(grid_q) - 1 - steady.last)


def _fold(recording: Recording, index: np.ndarray, steady: Steady, samples: int) -> Average | None:
    """Average the samples of each phase; None when a phase has fewer than two samples."""
    count = steady.periods * samples
    start = steady.last - count + 1
    inside = (index >= start) & (index <= steady.last)
    place = index[inside] - start
    whole = len(place) == count

    def periods(values: Array) -> Array:
        if whole:  # nothing is missing: the samples as they are
            first = int(np.argmax(inside))
            return values[first : first + count].reshape(steady.periods, samples, -1)
        table = np.full((count, values.shape[1]), np.nan)
        table[place] = values[inside]
        return table.reshape(steady.periods, samples, -1)

    q, tau = periods(recording.q), periods(recording.tau)
    return None if np.isfinite(q[:, :, 0]).sum(axis=0).min() < 2 else mean_of(q, tau)


def mean_of(q: Array, tau: Array) -> Average:
    """Return the mean of periods q and tau [M, N, n] (gaps nan), periods that are unlike the others left out."""
    present = np.isfinite(q[:, :, 0]).sum(axis=0)
    outlying = sorted({*outlying_periods(tau), *outlying_periods(q, "position")})
    kept = np.setdiff1d(np.arange(len(q)), outlying)
    if outlying and np.isfinite(q[kept, :, 0]).sum(axis=0).min() >= 2:
        q, tau = q[kept], tau[kept]
        present = np.isfinite(q[:, :, 0]).sum(axis=0)
    else:
        outlying = []
    dof = float(np.sum(present - 1))
    mean_q, mean_tau = mean_of_periods(q), mean_of_periods(tau)
    return Average(
        mean_q,
        mean_tau,
        np.array([np.nansum((q[:, :, j] - mean_q[:, j]) ** 2) for j in range(q.shape[2])]) / dof,
        np.array([np.nansum((tau[:, :, j] - mean_tau[:, j]) ** 2) for j in range(tau.shape[2])]) / dof,
        dof,
        float(1.0 / np.mean(1.0 / present)),
        tau,
        tau,
        left_out=tuple(m + 1 for m in outlying),
        off_clock=off_clock(q),
    )


def grid_of_lines(samples: int, lines: int) -> int:
    """Return how many points a period of so many samples needs where only so many lines of it are known: no fewer than
    it has samples, finer lest the jumps of Coulomb's column alias into the lines.
    """
    from scipy.fft import next_fast_len

    return min(_FINER * samples, next_fast_len(int(max(samples, FINE * lines)), real=True))


def _fit(recording: Recording, clock: Clock, steady: Steady) -> Average:
    """Fit the lines of one period to samples that fall on no common grid, in least squares."""
    first = clock.t[0] + (steady.last - steady.periods * steady.period + 1) * clock.dt
    last = clock.t[0] + (steady.last + 0.5) * clock.dt
    inside = (clock.t >= first - 0.5 * clock.dt) & (clock.t <= last)
    t = clock.t[inside] - first
    frequency = 1.0 / (steady.period * clock.dt)
    count = min(int(0.45 * steady.period), _LARGEST_FIT)
    samples = grid_of_lines(round(steady.period), count)
    both = np.hstack([recording.q[inside], recording.tau[inside]])
    lines = fit_lines(t, both, frequency, count)
    mean = evaluate(lines, samples, frequency)
    rest = both - _at(lines, t, frequency)
    dof = float(len(t) - 2 * count - 1)
    variance = np.sum(rest**2, axis=0) / dof
    n = recording.q.shape[1]
    # white noise of variance s^2 over S samples leaves s^2 (2 K + 1) / S on the curve: S / N averages, low-passed to
    # 2 K + 1 of N
    averages = len(t) / samples
    note = f"samples fall on no common grid of phases: {count} Fourier lines fitted in least squares"
    # what the fit left, on the nearest even grid of phases
    even = round(steady.period)
    table = np.full((steady.periods * even, n), np.nan)
    table[np.clip(np.rint(t * frequency * even).astype(int), 0, len(table) - 1)] = rest[:, n:]
    scatter = table.reshape(steady.periods, even, n)
    return Average(mean[:, :n], mean[:, n:], variance[:n], variance[n:], dof, averages, None, scatter, note, count)


def _at(c: Lines, t: Array, frequency: float) -> Array:
    """Return the signal of lines c at times t."""
    out = np.empty((len(t), c.shape[1]))
    for rows in np.array_split(np.arange(len(t)), max(1, len(t) * len(c) // 4_000_000)):
        phase = np.exp(2j * np.pi * frequency * np.outer(t[rows], np.arange(len(c))))
        out[rows] = np.real(phase @ c)
    return out


def mean_cycle(recording: Recording, clock: Clock, cycles: Cycles) -> Average:
    """Return the mean of the cycles with the scatter about it.

    Positions are interpolated by a quintic spline, torque by a local cubic one, since noise must not ring; samples
    beside a gap don't count.
    """
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline

    q, tau, present = even_samples(recording, clock)
    grid = clock.t[0] + clock.dt * np.arange(len(q))
    times = cycles.times
    there = np.interp(times, grid, present.astype(float)) > 0.999
    table = make_interp_spline(grid, q, k=5)(times)
    torque = CubicHermiteSpline(grid, tau, np.gradient(tau, clock.dt, axis=0))(times)
    if not there.all():
        enough = there.sum(axis=0) >= 2
        hidden = ~there & enough
        table[hidden], torque[hidden] = np.nan, np.nan
    return mean_of(table, torque)


def cycle_notes(cycles: Cycles, mean: Average) -> tuple[str, ...]:
    """Return what was found, in words."""
    moves = len(cycles.samples)
    found = (
        f"{mean.periods} cycles of {moves} move{'s' if moves > 1 else ''}, {cycles.length:.4g} s each, found and"
        " aligned move by move; they count as periods"
    )
    if not cycles.pieces:
        return (found,)
    return (found, f"{cycles.pieces} of {cycles.moves} moves belong to no whole cycle and are left out")


_STRAYS = 3.0  # times its noise: how far the position may stray from period to period without a second look
_KEPT = 0.5  # of the recording that periods should hold
_CALMER, _MORE = 0.25, 1.5  # variance of the positions, and share of the recording, for which cycles are preferred


def cycles_instead(recording: Recording, clock: Clock, q: Array, mean: Average | None) -> tuple[Cycles, Average] | None:
    """Return the cycles of a recording with their mean, None where there are none or the periods of `mean` serve as
    well; q [N, n]: its positions on the even grid.

    Cycles that start when they may look like periods that are not quite kept: positions stray more from period to
    period than noise does, or periods hold few of the samples. Aligned cycles repeat far better, or hold far more.
    """
    samples = 0 if mean is None else mean.scatter[:, :, 0].size
    if mean is not None and samples >= _KEPT * len(q):
        strays = np.sqrt(mean.q_variance) > _STRAYS * np.maximum(roughness(q), 1e-12)
        if not strays.any():
            return None
    cycles = find_cycles(q, clock.dt, float(clock.t[0]))
    if cycles is None:
        return None
    aligned = mean_cycle(recording, clock, cycles)
    if mean is not None and aligned.scatter[:, :, 0].size <= _MORE * samples:
        calmer = float(np.mean(aligned.q_variance / np.maximum(mean.q_variance, 1e-300))) < _CALMER
        if not calmer:
            return None
    return cycles, aligned
