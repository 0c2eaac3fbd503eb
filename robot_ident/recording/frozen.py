"""Efforts that stop while their joint moves on: a driver that repeats its last value, or a bus that lost its sensor.

Noise and motion move an effort from sample to sample. How long it may stand on one value while its joint moves is seen
in the rest of the recording: a coarse effort stands for all lengths of time, a frozen one for one that nothing else
comes near. Rows at which it stood are no torque: they are bridged, and count for nothing at that joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from robot_ident.recording.clock import Clock
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.recording import Recording
from robot_ident.recording.saturation import find_clipped, left_out, moving_samples, near
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Mask

_LONG = 0.5  # s in motion on one value
_LONGEST = 10.0  # times as many samples in motion as it stands on any other value, but for what else is frozen
_USUAL = 50.0  # times as many as it stands on the others in the mean
_SEEN = 0.02  # of the samples in motion, in which it must not stand: what is usual is unknown with fewer
_STEPS = 2.0  # of its resolution, by which an effort changes from sample to sample where it changes, in the median


def find_frozen(recording: Recording, units: Sequence[str] = ()) -> tuple[Mask, dict[int, str]]:
    """Return at which samples [N, n] an effort, as published, stands while its joint moves, though it can't, and what
    is said of each such joint.

    units: of the efforts, by joint; none are said where it is empty.
    """
    at: Mask = np.zeros(recording.tau.shape, dtype=bool)
    said: dict[int, str] = {}
    if recording.samples < 50:
        return at, said
    cut, _ = find_clipped(recording)
    sample = float(np.median(np.diff(recording.t)))
    for joint, name in enumerate(recording.names):
        effort = recording.tau[:, joint]
        begins, ends = _standing(effort, moving_samples(recording.q[:, joint]), cut[:, joint], sample)
        if not len(begins):
            continue
        for begin, end in zip(begins, ends, strict=True):
            at[begin:end, joint] = True
        first, last = int(begins[0]), int(ends[0]) - 1
        unit = f" {units[joint]}" if units else ""
        more = f", and {len(begins) - 1} times more" if len(begins) > 1 else ""
        said[joint] = (
            f"the effort of {name} stands at {effort[first]:.4g}{unit} for {recording.t[last] - recording.t[first]:.1f}"
            f" s from {recording.t[first]:.2f} s on while the joint moves{more}: these rows do not count"
        )
    return at, said


def _standing(effort: Array, moves: Mask, cut: Mask, sample: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples where an effort [N] begins to stand on one value, and where it changes again, of every time
    that it can't have stood: it is no bound, and nothing else comes near it.
    """
    edges = np.concatenate([[0], np.flatnonzero(np.diff(effort) != 0.0) + 1, [len(effort)]])
    begins, ends = edges[:-1], edges[1:]
    moved = np.concatenate([[0], np.cumsum(moves)])
    length = np.where(cut[begins], 0, moved[ends] - moved[begins])
    long = length * sample >= _LONG
    usual = length[~long & (length > 0)]
    if not long.any() or usual.sum() < _SEEN * length.sum() or _step_by_step(effort, moves):
        return begins[:0], ends[:0]
    frozen = long & (length >= max(_LONGEST * usual.max(), _USUAL * usual.mean()))
    return begins[frozen], ends[frozen]


def _step_by_step(effort: Array, moves: Mask) -> bool:
    """Return whether an effort [N] changes by single steps of its resolution while its joint moves: the smallest
    difference of any two of its values.
    """
    values = np.diff(np.unique(effort))
    rounding = 8.0 * np.finfo(float).eps * float(np.abs(effort).max())
    change = np.abs(np.diff(effort))[moves[1:]]
    change = change[change > rounding]
    values = values[values > rounding]
    return not len(change) or not len(values) or float(np.median(change)) < _STEPS * float(values.min())


def bridged(recording: Recording, at: Mask) -> Recording:
    """Return a recording whose efforts pass in a straight line what is frozen [N, n]: no low pass then takes a leap
    from there to the rows beside it.
    """
    tau = np.array(recording.tau)
    for joint in np.flatnonzero(at.any(axis=0)):
        stands = at[:, joint]
        tau[stands, joint] = np.interp(recording.t[stands], recording.t[~stands], tau[~stands, joint])
    return replace(recording, tau=tau)


def without_frozen(made: Measurement, at: Mask, said: dict[int, str], clock: Clock, robot: Robot) -> Measurement:
    """Return a measurement less the rows of what was frozen [N, n] in any of its periods.

    Where efforts are coupled, a frozen one is missing in the torque of every joint that it moves. Raises InputError
    where too little of a joint is left.
    """
    if not said:
        return made
    words = said
    if robot.effort.coupling is not None:
        shared = np.asarray(robot.effort.coupling) != 0.0
        words = {
            joint: "; ".join(line for effort, line in said.items() if shared[joint, effort])
            for joint in range(robot.n)
            if shared[joint, list(said)].any()
        }
        at = at @ shared.T
    one_pass = isinstance(made.low_pass, ZeroPhaseLowPass)
    reach = made.low_pass.smear() if isinstance(made.low_pass, ZeroPhaseLowPass) else 1  # as beside a gap
    touched = near(made, at, clock, reach * made.dt)
    return left_out(made, touched, words, "record again, and look for what the driver lost", spread=not one_pass)
