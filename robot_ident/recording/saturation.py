"""Efforts that a driver cuts off: the torque beyond its bound is not in the recording, and no fit may take it for less.

A clipped effort stands at one and the same value, its largest or its smallest, far more often than at any value near
it. What was cut off tells nothing of the torque: rows within reach of it are left out, in every period, since keeping
those that noise happened to hold below the bound would bend the mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.clock import Clock
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording
from robot_ident.signals.motion import Array, Mask

_LEAST, _SHARE = 20, 0.005  # samples, and share of them, that stand at a bound
_OFTEN = 5.0  # times as often as at any of the next values
_NEXT = 5  # of these values
_DITHER = 0.5  # share of samples that differ from the one before, below which plateaus are what rounding makes
_WINDOW, _CRAWL = 10, 0.02  # samples over which a joint moves or not, and the share of its fastest that is motion
_REACH = 0.1  # s around what was cut off, within which noise decides what is
_TOUCHED = 0.02  # of a low-passed row
_ENOUGH = 0.25  # of a joint's rows, which have to be left


def find_clipped(recording: Recording) -> tuple[Mask, dict[int, str]]:
    """Return which efforts [N, n] of a recording, as published, are cut off, and what is said of each such joint."""
    at: Mask = np.zeros(recording.tau.shape, dtype=bool)
    said: dict[int, str] = {}
    if recording.samples <= _WINDOW:
        return at, said
    for joint, (name, effort, q) in enumerate(zip(recording.names, recording.tau.T, recording.q.T, strict=True)):
        moves = moving_samples(q)
        bounds = [bound for bound in (float(effort.max()), float(effort.min())) if _cut_off(effort, bound, moves)]
        if bounds:
            at[:, joint] = np.isin(effort, bounds)
            said[joint] = (
                f"the effort of {name} stands at {' and '.join(f'{b:g}' for b in bounds)} in"
                f" {100.0 * at[:, joint].mean():.2g} % of the samples: clipped by its driver"
            )
    return at, said


def moving_samples(q: Array) -> Mask:
    """Return at which samples [N] a joint moves: where a brake holds it, its effort may well be one number."""
    travel = np.abs(q[_WINDOW:] - q[:-_WINDOW])
    whole = np.pad(travel, (_WINDOW // 2, len(q) - len(travel) - _WINDOW // 2), mode="edge")
    return np.asarray(whole > _CRAWL * travel.max())


def _cut_off(effort: Array, bound: float, moves: Mask) -> bool:
    """Return whether an effort [N] stands at its extreme value so often that it must have been cut off there."""
    count = int(np.sum((effort == bound) & moves))
    if bound == 0.0 or count < max(_LEAST, _SHARE * len(effort)) or np.ptp(effort) == 0.0:
        return False
    inside = (effort[1:] != effort.max()) & (effort[1:] != effort.min())
    if inside.any() and np.mean(np.diff(effort)[inside] != 0.0) < _DITHER:
        return False
    values, counts = np.unique(effort, return_counts=True)
    beside = counts[1 : 1 + _NEXT] if values[0] == bound else counts[-1 - _NEXT : -1]
    return bool(count > _OFTEN * beside.max(initial=1))


def without_clipped(made: Measurement, recording: Recording, clock: Clock) -> Measurement:
    """Return a measurement less the rows near what was cut off in any of its periods, its noise that of the rest.

    recording: as published. Raises InputError where too little of a joint is left.
    """
    at, said = find_clipped(recording)
    if not said:
        return made
    words = {joint: f"{line}; what lies within {_REACH:g} s of it is left out" for joint, line in said.items()}
    remedy = "record one that needs less torque, or have the driver publish more"
    made = left_out(made, near(made, at, clock, _REACH), words, remedy)
    return replace(made, clipped=tuple(words.values()))


def left_out(
    made: Measurement, touched: Mask, words: Mapping[int, str], remedy: str, *, spread: bool = True
) -> Measurement:
    """Return a measurement less rows [N, n] whose torque isn't known, its noise that of the rest; words: why, by joint.

    spread: where the low pass takes them to. Raises InputError where too little of a joint is left, with a remedy.
    """
    if spread and made.low_pass is not None:
        touched = np.abs(made.low_pass.apply(touched.astype(float))) > _TOUCHED
    used = made.used & ~touched
    for joint, line in words.items():
        if used[:, joint].sum() < _ENOUGH * made.used[:, joint].sum():
            raise InputError(f"{made.source}: {line}, and too little of the motion is left beside it; {remedy}")
    unknown = touched if made.unknown is None else made.unknown | touched
    notes = (*made.notes, *dict.fromkeys(words.values()))
    return replace(_with_noise(made, touched), used=used, unknown=unknown, notes=notes)


def near(made: Measurement, at: Mask, clock: Clock, reach: float) -> Mask:
    """Return the rows [N, n] of a measurement within reach [s] of samples [N', n] of its recording, in any period."""
    begins = np.array(made.motion.began or (0.0,))[:, None]
    rows = np.arange(made.motion.samples) * made.dt
    places = begins + rows if made.cycles is None else made.cycles.times - clock.t[0]
    t = clock.t - clock.t[0]
    out = np.zeros((made.motion.samples, at.shape[1]), dtype=bool)
    for joint in np.flatnonzero(at.any(axis=0)):
        begun = np.searchsorted(t[at[:, joint]] - reach, places, side="right")
        out[:, joint] = (begun > np.searchsorted(t[at[:, joint]] + reach, places, side="left")).any(axis=0)
    return out


def _with_noise(made: Measurement, touched: Mask) -> Measurement:
    """Return a measurement with the noise of the rows that are left: what stands at a bound doesn't scatter."""
    if made.period_torque is None:
        return made
    single = made.period_torque
    variance = np.array(made.torque_variance)
    for joint in np.flatnonzero(touched.any(axis=0)):
        rows = single[:, ~touched[:, joint], joint]
        dof = np.maximum(np.isfinite(rows).sum(axis=0) - 1, 0).sum()
        if dof > 0:
            variance[joint] = np.nansum((rows - np.nanmean(rows, axis=0)) ** 2) / dof
    scale = np.sqrt(variance / made.torque_variance)
    noise = made.noise
    if noise is not None:
        density = noise.density * scale[:, None] * scale
        noise = replace(noise, density=density, variance=noise.variance * scale**2)
    return replace(made, torque_variance=variance, noise=noise)
