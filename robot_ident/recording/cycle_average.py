"""The mean cycle of production data: moves aligned to a part of a sample, then treated as periods are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.recording.averaging import Average, mean_of
from robot_ident.recording.clock import Clock
from robot_ident.recording.cycles import Cycles
from robot_ident.recording.measurement import Measurement, Processing
from robot_ident.recording.non_periodic import DEFAULT_LOW_PASS, even_samples
from robot_ident.recording.periodic import of_mean
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import SoftPeriodicLowPass

_ROWS = 5.0  # a second per Hz of the low pass: it leaves 7e-4 of what lies beyond half of that
_TOUCHED = 0.02  # of a filtered row: the share of standstill from which on it counts as standstill


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


def averaged_cycles(
    recording: Recording, clock: Clock, cycles: Cycles, robot: Robot, processing: Processing
) -> Measurement:
    """Return the mean cycle of a recording; torque and columns pass a low pass, as those of one pass do.

    A robot's moves begin and end at rest with acceleration that jumps: more than the positions can tell. Rows that
    the low pass mixes with standstill, where stiction hides the torque, don't count; of the others as many are kept
    as tell anything new, columns being computed at every sample before they pass it.
    """
    mean = mean_cycle(recording, clock, cycles)
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
