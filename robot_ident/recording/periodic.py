"""Periods or cycles averaged: the noise without a model, velocity and acceleration from the Fourier lines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.recording.averaging import Average, cycle_notes, grid_of_lines
from robot_ident.recording.clock import Clock
from robot_ident.recording.cycles import Cycles
from robot_ident.recording.measurement import DEFAULT_LOW_PASS, Measurement, Processing
from robot_ident.recording.noise_spectrum import NoiseSpectrum, noise_spectrum
from robot_ident.recording.period import AT_REST, Steady
from robot_ident.recording.recording import Recording
from robot_ident.recording.resolution import position_step
from robot_ident.recording.torque_channel import Chain, chain_of
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import PeriodicLowPass, SoftPeriodicLowPass
from robot_ident.signals.fourier import above_noise, evaluate, lines_of_grid, share_of_motion
from robot_ident.signals.motion import Array, Mask, Motion

_SEVERAL = 0.01  # of a joint's rows
_KINK = 9.0  # (|c_k| / its noise)^2 below which a Fourier line may hide among noise
_MANY = 2.0  # periods of motion before those that are averaged, from which on it is more than approach and transient
_PAUSE = 1.0  # s without samples that are named


def _set_aside(t: Array, end: float, length: float, period: float, where: str, what: str) -> list[str]:
    """Return a line, if anything is to be said, on so much of a recording up to `end` [s] beside the averaged periods.

    Motion of two periods and more isn't the way in: it repeats, but not as they do, or not in step.
    """
    start = end - length
    steps = np.diff(t)
    pauses = np.flatnonzero((steps > _PAUSE) & (t[1:] > start) & (t[:-1] < end))
    moving = max(end - start - float(steps[pauses].sum()), 0.0)
    said = [f"no samples for {steps[k]:.4g} s from {t[k]:.4g} s on" for k in pauses[:3]]
    if moving >= _MANY * period:
        said.append(
            f"{int(moving / period)} periods that are not in step with the others (a pause, another motion, or a clock"
            " that drifts or jumps)"
        )
    if said:
        return [f"{end - start:.4g} s {where} left out: {'; '.join(said)}"]
    return [f"{length:.3g} s {what} left out"] if length > 0 else []


STANDSTILL = 0.02  # rad/s: below it, stiction leaves the torque undetermined
_SILENT = 1e-5  # of a joint's torque: no sensor has less noise; below it is rounding, or a simulation without noise
_WHITE = 0.1  # share of rounding in the error of a position from which on that error is not white
_FEW = 5  # periods, below which a drift can't be told from chance
_CHANCE = 1e-4  # of a drift of the mean effort where there is none
_REVERSAL = 2e-3  # share of the top speed within which the sign of a sampled velocity is not trusted


def averaged(
    recording: Recording, clock: Clock, steady: Steady, mean: Average, robot: Robot, processing: Processing
) -> Measurement:
    """Return the measurement of the mean period of a recording's steady part.

    The variance of one sample is the scatter about the mean period, divided by M N - N (not by M N - 1, which is 1 /
    M too small).
    """
    period = steady.period
    start = steady.last - int(steady.periods * period + 1e-6) + 1
    notes = [f"{mean.periods} periods of {period * clock.dt:.6g} s averaged"]
    t, before, after = clock.t - clock.t[0], max(start, 0) * clock.dt, max(mean.after, 0) * clock.dt
    notes += _set_aside(t, before, before, period * clock.dt, "before the periods", "of approach and transient")
    notes += _set_aside(t, float(t[-1]), after, period * clock.dt, "after the periods", "after the periods")
    out = of_mean(recording, mean, period, 1.0 / clock.dt, robot, processing)
    notes += out.notes
    if processing.derivative_bandwidth is not None:
        notes.append(
            "--derivative-bandwidth is for what does not repeat; here velocity and acceleration come from the lines"
        )
    kept = [number for number in range(steady.periods) if number + 1 not in mean.left_out]
    began = tuple((start + number * period) * clock.dt for number in kept)
    return replace(out, motion=replace(out.motion, began=began), notes=tuple(notes))


def of_mean(
    recording: Recording, mean: Average, period: float, rate: float, robot: Robot, processing: Processing
) -> Measurement:
    """Return the measurement of a mean period of so many samples (a part of one counts) at a sample rate [Hz]."""
    frequency = rate / period
    chain = chain_of(robot, processing.anti_alias, recording.source, rate, frequency)
    rounding = _rounding(_quantum(recording.tau), mean.tau_variance) * len(mean.q) / round(period)
    mean, noise = _undone(mean, chain, frequency, round(period))
    least = (_SILENT * np.sqrt(np.mean(mean.tau**2, axis=0))) ** 2
    quiet = (mean.tau_variance < least) & (rounding < least)
    silent = [name for name, small in zip(robot.joints, quiet, strict=True) if small]
    mean, noise = replace(mean, tau_variance=np.maximum(mean.tau_variance, least)), noise.with_floor(least)
    motion, variance, strong, share = _motion(mean, frequency, robot, recording)
    dt = period / rate / len(mean.q)
    trust = trusted(motion, robot, processing, velocity_noise(share, variance, frequency, len(mean.q)))
    directed = direction_known(motion, strong, variance, frequency, dt)
    cutoff = processing.low_pass
    chain.check_low_pass(cutoff or 0.0, recording.source)
    if mean.lines is not None:
        cutoff = min(cutoff or np.inf, mean.lines * frequency)
    notes = _notes(mean, chain, noise, robot, silent)
    lost = zip(robot.joints, (trust & ~directed).mean(axis=0), strict=True)
    listed = ", ".join(f"{name} {100 * share:.0f} %" for name, share in lost if share > _SEVERAL)
    if listed:
        notes.append(f"rows at reversals left out, where noise hides which way a joint moves: {listed}")
    return Measurement(
        source=recording.source,
        joints=recording.names,
        dt=dt,
        motion=motion,
        torque=mean.tau,
        used=trust & directed,
        standstill=at_rest(motion, robot),
        torque_variance=mean.tau_variance,
        position_variance=mean.q_variance,
        periods=mean.periods,
        samples_per_period=round(period),
        averages=mean.averages,
        variance_dof=mean.dof,
        base_frequency=frequency,
        low_pass=None if cutoff is None else PeriodicLowPass(cutoff, frequency, len(mean.q)),
        decimate=processing.decimate,
        period_torque=mean.periods_of_tau,
        notes=tuple(notes),
        noise=noise,
        quantisation=rounding if rounding.any() else None,
        position_lines=strong,
        line_share=share,
        averaged_position_variance=variance,
        left_out=mean.left_out,
        off_clock=mean.off_clock,
    )


def _notes(mean: Average, chain: Chain, noise: NoiseSpectrum, robot: Robot, silent: Sequence[str]) -> list[str]:
    """Return a line for each thing that was left out, undone or found of the noise; silent: joints without any."""
    notes = []
    if mean.left_out:
        which = ", ".join(str(m) for m in mean.left_out)
        word, own = ("period", "its scatter is") if len(mean.left_out) == 1 else ("periods", "their scatter is")
        notes.append(f"{word} {which} of {mean.periods + len(mean.left_out)} left out: {own} far above the others'")
    if mean.note:
        notes.append(mean.note)
    if chain.note:
        notes.append(chain.note)
    coloured = [name for name, found in zip(robot.joints, noise.coloured, strict=True) if found]
    if coloured:
        notes.append(f"the torque noise of {', '.join(coloured)} is not white; its spectrum is taken into account")
    if noise.correlated:
        notes.append("the torque noise of the joints is correlated; its covariance is taken into account")
    notes += _drifting(mean, robot)
    if silent:
        notes.append(
            f"the torque of {', '.join(silent)} repeats without noise; a hundred-thousandth of it is taken for its"
            " noise, so that sigma and what exceeds it mean little"
        )
    return notes


def _drifting(mean: Average, robot: Robot) -> list[str]:
    """Say of which joints the mean effort changes from period to period along a straight line, and by how much.

    A t test of the slope; a friction that falls with temperature has no mean over a period.
    """
    periods = mean.periods_of_tau
    if periods is None or len(periods) < _FEW:
        return []
    from scipy.special import stdtr

    level = np.nanmean(periods, axis=1)
    when = np.arange(len(level)) - (len(level) - 1) / 2.0
    slope = when @ level / (when @ when)
    left = level - level.mean(axis=0) - np.outer(when, slope)
    std = np.sqrt(np.sum(left**2, axis=0) / (len(level) - 2) / (when @ when))
    chance = 2.0 * stdtr(len(level) - 2, -np.abs(slope) / np.maximum(std, 1e-300))
    return [
        f"the mean effort of {name} drifts by {slope[k] * (len(level) - 1):+.3g} {robot.torque_unit(k)} over the"
        " periods: an offset that changes (a torque sensor or a hose that warms up), which the parameters of weight"
        " take in"
        for k, name in enumerate(robot.joints)
        if chance[k] < _CHANCE
    ]


def _undone(mean: Average, chain: Chain, frequency: float, samples: int) -> tuple[Average, NoiseSpectrum]:
    """Return the mean period without the measuring chain, exactly at every line, and the noise that is left in it.

    Where a filter was inverted the torque has no lines beyond its bandwidth; the grid is then finer, lest the jumps of
    Coulomb's column alias into the band.
    """
    grid = len(mean.q)
    if chain.trivial:
        white = mean.lines is not None
        noise = noise_spectrum(mean.scatter, None if white else mean.tau_variance, lines=mean.lines, grid=grid)
        if not white:
            return mean, noise
        return replace(mean, tau_variance=noise.variance, dof=noise.variance_dof), noise
    rates = np.arange(grid // 2 + 1, dtype=float) * frequency
    lines = mean.lines
    if chain.filtered:
        lines = min(int(chain.bandwidth / frequency + 1e-9), (samples - 1) // 2 if lines is None else lines)
    finer = grid if mean.lines is not None or lines is None else grid_of_lines(grid, lines)
    response = chain.response(rates)
    noise = noise_spectrum(mean.scatter, None, lines=lines, response=response, grid=finer)

    def undone(x: Array) -> Array:
        c = lines_of_grid(x) / response
        if lines is not None:
            c = c[: lines + 1]
        return evaluate(c, finer, frequency)

    periods = None
    if mean.periods_of_tau is not None:
        whole = np.where(np.isfinite(mean.periods_of_tau), mean.periods_of_tau, mean.tau)
        periods = np.stack([undone(one) for one in whole])
    q = mean.q if finer == grid else evaluate(lines_of_grid(mean.q), finer, frequency)
    return (
        replace(
            mean,
            q=q,
            tau=undone(mean.tau),
            tau_variance=noise.variance,
            dof=noise.variance_dof,
            averages=mean.averages * grid / finer,
            periods_of_tau=periods,
            lines=lines,
        ),
        noise,
    )


def direction_known(motion: Motion, lines: Mask, variance: Array, frequency: float, dt: float) -> Mask:
    """Return the rows [N, n] where kinks of the path that noise hides can't have turned the direction of motion.

    lines [K + 1, n]: Fourier lines of the positions that stand above white noise of `variance` [n] rad^2 a row, at
    multiples of `frequency` [Hz]; dt: between rows [s]. A drive that sticks or gives way as it reverses bends its
    velocity at once. Lines of such a kink fall with the third power of frequency, so that those beyond the last one
    above the noise (at f_c, of amplitude c) add up to a velocity of 2 pi c f_c^2 / f_0 beside the reversal. No more is
    given up than the motion usually gains within a sample.
    """
    amplitude = np.sqrt(_KINK * 4.0 * variance / len(motion.q))
    hidden = 2.0 * np.pi * amplitude * lines.sum(axis=0) ** 2 * frequency
    usual = np.sqrt(np.mean(motion.ddq**2, axis=0)) * dt
    return np.asarray(np.abs(motion.dq) >= np.minimum(hidden, usual))


def trusted(motion: Motion, robot: Robot, processing: Processing, speed_noise: Array) -> Mask:
    """Return rows [N, n] whose direction of motion is certain and whose speed is above the minimum.

    A joint that stands still has none: what flickers there is noise.
    """
    minimum = robot.minimum_speed if processing.minimum_speed is None else np.array(processing.minimum_speed)
    speed = np.abs(motion.dq)
    floor = np.maximum(np.maximum(_REVERSAL * speed.max(axis=0), 4.0 * speed_noise), minimum)
    return np.asarray((speed >= floor) & (np.ptp(motion.q, axis=0) >= AT_REST))


def at_rest(motion: Motion, robot: Robot) -> Mask:
    """Return rows [N, n] at standstill: below 0.02 rad/s, on a prismatic joint below 2 % of its top speed."""
    top = np.abs(motion.dq).max(axis=0)
    bound = np.where(robot.prismatic, 0.02 * top, STANDSTILL)
    return np.asarray(np.abs(motion.dq) < bound)


def _motion(mean: Average, frequency: float, robot: Robot, recording: Recording) -> tuple[Motion, Array, Mask, Array]:
    """Return the motion from what its lines hold beside noise, the noise variance [n] of the averaged position, which
    lines stand above the noise [K + 1, n], and the share of each that the motion takes [K + 1, n].
    """
    samples = len(mean.q)
    lines = lines_of_grid(mean.q)
    declared = robot.drives.encoder_step
    # a driver or message may round more coarsely than the encoder does
    step = np.maximum(np.where(declared > 0, declared, _quantum(recording.q)), position_step(recording.q))
    rounding = _rounding(step, mean.q_variance)
    variance = mean.q_variance / mean.averages + rounding
    strong = above_noise(lines, variance, samples)
    white = rounding < _WHITE * variance
    share = np.where(white, share_of_motion(lines, strong, variance, samples), strong)
    q, dq, ddq = (evaluate(share * lines, samples, frequency, derivative) for derivative in (0, 1, 2))
    return Motion(q, dq, ddq, dt=1.0 / (frequency * samples), periodic=True), variance, strong, share


def velocity_noise(share: Array, variance: Array, frequency: float, samples: int) -> Array:
    """Return the error [n] rad/s of the velocity that shares of the measured lines give."""
    rates = 2.0 * np.pi * frequency * np.arange(len(share))[:, None]
    return np.asarray(np.sqrt(np.sum(share * rates**2, axis=0) * variance * 2.0 / samples))


def _rounding(step: Array, variance: Array) -> Array:
    """Return the variance [n] that rounding to `step` leaves however often one averages: like values round alike.

    step^2 / 12 without noise; noise of s^2 dithers it away: r(s) = step^2 / 12 exp(-4 pi^2 s^2 / step^2), its first
    harmonic. What is dithered scatters: variance = s^2 + step^2 / 12 - r(s) is seen, which bisection solves for s.
    """
    size = np.where(step > 0, step, 1.0)
    seen = np.minimum(np.sqrt(variance) / size, 100.0)  # beyond, nothing is left, and squares may overflow
    low, high = np.zeros_like(seen), seen
    for _ in range(40):
        middle = 0.5 * (low + high)
        less = middle**2 + (1.0 - np.exp(-4.0 * np.pi**2 * middle**2)) / 12.0 < seen**2
        low, high = np.where(less, middle, low), np.where(less, high, middle)
    left = size**2 / 12.0 * np.exp(-4.0 * np.pi**2 * low**2)
    return np.asarray(np.where(step > 0, left, 0.0))


def _quantum(x: Array) -> Array:
    """Return the smallest step [n] in which the columns of x [N, n] change."""
    out = np.zeros(x.shape[1])
    for joint, column in enumerate(x.T):
        steps = np.diff(np.unique(column))
        steps = steps[steps > 1e-7 * np.ptp(column)]
        out[joint] = steps.min() if len(steps) else 0.0
    return out


_ROWS = 5.0  # a second per Hz of the low pass: it leaves 7e-4 of what lies beyond half of that
_TOUCHED = 0.02  # of a filtered row: the share of standstill from which on it counts as standstill


def averaged_cycles(
    recording: Recording, clock: Clock, cycles: Cycles, mean: Average, robot: Robot, processing: Processing
) -> Measurement:
    """Return the measurement of the mean cycle; torque and columns pass a low pass, as those of one pass do.

    A robot's moves begin and end at rest with acceleration that jumps: more than the positions can tell. Rows that
    the low pass mixes with standstill, where stiction hides the torque, don't count; of the others as many are kept
    as tell anything new, columns being computed at every sample before they pass it.
    """
    samples = sum(cycles.samples)
    made = of_mean(recording, mean, samples, 1.0 / clock.dt, robot, replace(processing, low_pass=None))
    cutoff = processing.low_pass or min(DEFAULT_LOW_PASS, 0.2 / clock.dt)
    if made.low_pass is not None:
        cutoff = min(cutoff, made.low_pass.cutoff)
    low_pass = SoftPeriodicLowPass(cutoff, 1.0 / cycles.length, made.motion.samples)
    touched = low_pass.apply(made.standstill.astype(float)) > _TOUCHED
    began = tuple(
        float(begin - clock.t[0]) for k, begin in enumerate(cycles.begins[:, 0]) if k + 1 not in mean.left_out
    )
    return replace(
        made,
        motion=replace(made.motion, began=began),
        used=made.used & ~touched,
        low_pass=low_pass,
        decimate=max(made.decimate, int(1.0 / (_ROWS * cutoff * made.dt))),
        cycles=cycles,
        notes=(*cycle_notes(cycles, mean), f"low-passed at {cutoff:g} Hz", *made.notes),
    )
