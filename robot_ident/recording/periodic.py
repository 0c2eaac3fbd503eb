"""Periods averaged: the noise without a model, velocity and acceleration from the Fourier lines."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robot_ident.motion import Array, Mask, Motion
from robot_ident.recording.clock import Clock, even_positions, roughness
from robot_ident.recording.lines import Lines, above_noise, evaluate, fit_lines, lines_of_grid
from robot_ident.recording.low_pass import PeriodicLowPass
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.period import Steady, steady_part
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot

STANDSTILL = 0.02  # rad/s: below it, stiction leaves the torque undetermined
_REVERSAL = 2e-3  # share of the top speed within which the sign of a sampled velocity is not trusted
_LARGEST_FIT = 400  # lines of the least-squares fit where the samples don't fall on a grid
_FINER = 4  # points per sample of its grid: the jumps of Coulomb's column would alias into the band on a coarser one


@dataclass(frozen=True)
class Average:
    """Mean period on an even grid [N, n], per-sample variance [n] with its degrees of freedom, and the periods one by
    one.

    averages: how many samples' noise is averaged in each value. lines: where only so many lines of the torque are
    known. after: samples that follow the last period.
    """

    q: Array
    tau: Array
    q_variance: Array
    tau_variance: Array
    dof: float
    averages: float
    periods_of_tau: Array | None
    note: str
    lines: int | None = None
    after: int = 0


def averaged(recording: Recording, clock: Clock, period: float, robot: Robot, processing: Processing) -> Measurement:
    """Return the mean period of a recording's steady part.

    The variance of one sample is the scatter about the mean period, divided by M N - N (not by M N - 1, which is 1 /
    M too small).
    """
    steady, mean = average(recording, clock, period)
    frequency = 1.0 / (period * clock.dt)
    motion, speed_noise = _motion(mean, frequency, robot, recording)
    cutoff = processing.low_pass
    if mean.lines is not None:
        cutoff = min(cutoff or np.inf, mean.lines * frequency)
    cut = steady.last - int(steady.periods * period + 1e-6) + 1
    notes = [f"{steady.periods} periods of {period * clock.dt:.6g} s averaged"]
    if cut > 0:
        notes.append(f"{cut * clock.dt:.3g} s of approach and transient left out")
    after = mean.after
    if after > 0:
        notes.append(f"{after * clock.dt:.3g} s after the periods left out")
    if mean.note:
        notes.append(mean.note)
    return Measurement(
        source=recording.source,
        joints=recording.names,
        dt=period * clock.dt / len(mean.q),
        motion=motion,
        torque=mean.tau,
        used=trusted(motion, robot, processing, speed_noise),
        standstill=at_rest(motion, robot),
        torque_variance=mean.tau_variance,
        position_variance=mean.q_variance,
        periods=steady.periods,
        samples_per_period=round(period),
        averages=mean.averages,
        variance_dof=mean.dof,
        base_frequency=frequency,
        low_pass=None if cutoff is None else PeriodicLowPass(cutoff, frequency, len(mean.q)),
        decimate=processing.decimate,
        period_torque=mean.periods_of_tau,
        notes=tuple(notes),
    )


def average(recording: Recording, clock: Clock, period: float) -> tuple[Steady, Average]:
    """Return the steady part of a recording and its mean period; InputError when fewer than two periods are steady."""
    grid_q = even_positions(recording, clock)
    steady = steady_part(grid_q, period, roughness(grid_q), recording.source)
    samples, mean = round(period), None
    if clock.index is not None and abs(period - samples) * steady.periods < 0.1:
        mean = _fold(recording, clock.index, steady, samples)
    if mean is None:
        mean = _fit(recording, clock, steady)
    return steady, replace(mean, after=len(grid_q) - 1 - steady.last)


def trusted(motion: Motion, robot: Robot, processing: Processing, speed_noise: Array) -> Mask:
    """Return rows [N, n] whose direction of motion is certain and whose speed is above the minimum."""
    minimum = robot.minimum_speed if processing.minimum_speed is None else np.array(processing.minimum_speed)
    speed = np.abs(motion.dq)
    floor = np.maximum(np.maximum(_REVERSAL * speed.max(axis=0), 4.0 * speed_noise), minimum)
    return np.asarray(speed >= floor)


def at_rest(motion: Motion, robot: Robot) -> Mask:
    """Return rows [N, n] at standstill: below 0.02 rad/s, on a prismatic joint below 2 % of its top speed."""
    top = np.abs(motion.dq).max(axis=0)
    bound = np.where(robot.prismatic, 0.02 * top, STANDSTILL)
    return np.asarray(np.abs(motion.dq) < bound)


def _fold(recording: Recording, index: np.ndarray, steady: Steady, samples: int) -> Average | None:
    """Average the samples of each phase; None when a phase has fewer than two samples."""
    count = steady.periods * samples
    start = steady.last - count + 1
    inside = (index >= start) & (index <= steady.last)
    place = index[inside] - start

    def periods(values: Array) -> Array:
        table = np.full((count, values.shape[1]), np.nan)
        table[place] = values[inside]
        return table.reshape(steady.periods, samples, -1)

    q, tau = periods(recording.q), periods(recording.tau)
    present = np.isfinite(q[:, :, 0]).sum(axis=0)
    if present.min() < 2:
        return None
    dof = float(np.sum(present - 1))
    mean_q, mean_tau = np.nanmean(q, axis=0), np.nanmean(tau, axis=0)
    return Average(
        mean_q,
        mean_tau,
        np.nansum((q - mean_q) ** 2, axis=(0, 1)) / dof,
        np.nansum((tau - mean_tau) ** 2, axis=(0, 1)) / dof,
        dof,
        float(1.0 / np.mean(1.0 / present)),
        tau,
        "",
    )


def _fit(recording: Recording, clock: Clock, steady: Steady) -> Average:
    """Fit the lines of one period to samples that fall on no common grid, in least squares."""
    first = clock.t[0] + (steady.last - steady.periods * steady.period + 1) * clock.dt
    last = clock.t[0] + (steady.last + 0.5) * clock.dt
    inside = (clock.t >= first - 0.5 * clock.dt) & (clock.t <= last)
    t = clock.t[inside] - first
    frequency = 1.0 / (steady.period * clock.dt)
    count = min(int(0.45 * steady.period), _LARGEST_FIT)
    samples = _FINER * round(steady.period)
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
    return Average(mean[:, :n], mean[:, n:], variance[:n], variance[n:], dof, averages, None, note, count)


def _at(c: Lines, t: Array, frequency: float) -> Array:
    """Return the signal of lines c at times t."""
    out = np.empty((len(t), c.shape[1]))
    for rows in np.array_split(np.arange(len(t)), max(1, len(t) * len(c) // 4_000_000)):
        phase = np.exp(2j * np.pi * frequency * np.outer(t[rows], np.arange(len(c))))
        out[rows] = np.real(phase @ c)
    return out


def _motion(mean: Average, frequency: float, robot: Robot, recording: Recording) -> tuple[Motion, Array]:
    """Return the motion from every line above the noise, and the noise of its velocity [n] rad/s."""
    samples = len(mean.q)
    lines = lines_of_grid(mean.q)
    step = np.where(robot.drives.encoder_step > 0, robot.drives.encoder_step, _quantum(recording.q))
    # noise below the encoder's step does not average out: the same step is rounded in every period
    variance = np.maximum(mean.q_variance / mean.averages, np.where(mean.q_variance < step**2 / 4, step**2 / 12, 0.0))
    keep = above_noise(lines, variance, samples)
    kept = np.where(keep, lines, 0.0)
    rates = 2.0 * np.pi * frequency * np.arange(len(lines))[:, None]
    speed_noise = np.sqrt(np.sum(keep * rates**2, axis=0) * variance * 2.0 / samples)
    q, dq, ddq = (evaluate(kept, samples, frequency, derivative) for derivative in (0, 1, 2))
    return Motion(q, dq, ddq, dt=1.0 / (frequency * samples), periodic=True), speed_noise


def _quantum(q: Array) -> Array:
    """Return the smallest step [n] in which positions change."""
    out = np.zeros(q.shape[1])
    for joint, column in enumerate(q.T):
        steps = np.diff(np.unique(column))
        steps = steps[steps > 1e-12]
        out[joint] = steps.min() if len(steps) else 0.0
    return out
