"""Positions as a driver spoils them on their way, put right before anything is made of them, with a note on each.

The angle of a joint that turns endlessly is often wrapped to one turn: it jumps by 2 pi from one sample to the next,
with every velocity and low pass around it. It is continued; what depends on the angle of a joint has its period.

A position is held where joint states are published faster than the encoders are read. With K samples for each reading
the held ones are 1 to K - 1 samples older than the effort beside them, (K - 1) / 2 in the mean, and velocities stand on
steps. The first sample of each reading is as old as its effort and is kept, with that sample's effort: a mean of all K
efforts would be of a later time than the position.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

_TURN = 2.0 * np.pi
_NEAR = 0.1  # rad: how far from whole turns a step may lie that is a jump of a wrapped angle
_SURE = 0.1  # of a turn: a joint that moves farther from sample to sample may have turned either way
_BEYOND = 0.1  # rad: how far a joint may have turned beyond its range, which is rarely known better

_FAST = 3.0  # steps of its encoder a joint moves from one reading to the next: none stands still between two such
_HELD = 1.5  # samples for each reading, from which on positions are held
_READINGS = 50  # fast ones, which are needed
_IN_MOTION = 0.1  # of the samples, which must lie between fast readings
_EVENLY = 0.9  # of the distances between readings, within one sample of their mean


def repaired(recording: Recording, robot: Robot | None = None) -> Recording:
    """Return a recording whose wrapped angles are continued, without positions that are held, as its notes say; one
    that is repaired as it is.

    robot: whose joints count, all of the recording's where None. Raises InputError where the range of a joint can't
    hold its continued angle, and where positions are held for no regular number of samples.
    """
    known = recording.names if robot is None else robot.joints
    joints = [k for k, name in enumerate(recording.names) if name in known]
    return _without_held(_continued(recording, joints, robot), joints)


def _continued(recording: Recording, joints: list[int], robot: Robot | None) -> Recording:
    """Return a recording in which an angle goes on where it jumps by whole turns from one sample to the next."""
    q, notes = np.array(recording.q), list(recording.notes)
    for joint in joints:
        name = recording.names[joint]
        place = None if robot is None else robot.joints.index(name)
        if robot is not None and place is not None and robot.prismatic[place]:
            continue
        turns = _jumps(recording.t, q[:, joint])
        if not turns.any():
            continue
        q[1:, joint] -= _TURN * np.cumsum(turns)
        first = recording.t[1 + int(np.argmax(turns != 0.0))]
        said = f"{name} jumps by whole turns {int(np.sum(turns != 0.0))} times, first at {first:.3f} s"
        if robot is not None and place is not None:
            lower, upper = float(robot.limits.lower[place]), float(robot.limits.upper[place])
            lowest, highest = float(q[:, joint].min()), float(q[:, joint].max())
            if highest - lowest > upper - lower + _BEYOND:
                raise InputError(
                    f"{recording.source}: {said}: continued, it turns through {highest - lowest:.4g} rad, and its range"
                    f" is {lower:.4g} to {upper:.4g} rad: take its position limits out of the robot YAML if it turns"
                    " endlessly, else look for readings that the driver lost"
                )
            if np.isfinite(upper - lower):
                q[:, joint] += _TURN * round((0.5 * (lower + upper) - 0.5 * (lowest + highest)) / _TURN)
        notes.append(f"{said}: a wrapped angle, which is continued beyond them")
    return recording if len(notes) == len(recording.notes) else replace(recording, q=q, notes=tuple(notes))


def _jumps(t: Array, q: Array) -> Array:
    """Return by how many whole turns an angle [N] jumps from each sample to the next [N - 1]: where a step lies as near
    to whole turns as the joint moves elsewhere, and it moves by far less than a turn.
    """
    steps = np.diff(q)
    turns = np.rint(steps / _TURN)
    own = np.abs(steps[(turns == 0.0) & (steps != 0.0)])
    if not turns.any() or not len(own):
        return np.zeros(len(steps))
    lasts = np.diff(t)
    usual = float(np.percentile(own, 99.0)) * np.maximum(lasts / np.median(lasts), 1.0)  # farther in a gap
    near = np.abs(steps - _TURN * turns) < np.maximum(_NEAR, 2.0 * usual)
    return np.where(near & (usual < _SURE * _TURN), turns, 0.0)


def _without_held(recording: Recording, joints: list[int]) -> Recording:
    """Return the samples of a recording at which positions were read, where no joint's changes in most of the others;
    as it is where positions are read for every sample.

    The steps of an encoder and rests hold nothing: two changes count that follow each other, both of several steps.
    """
    move = np.abs(np.diff(recording.q[:, joints], axis=0))
    changes = np.flatnonzero(move.any(axis=1)) + 1
    if len(changes) <= _READINGS:
        return recording
    least = np.where(move > 0.0, move, np.inf).min(axis=0)
    fast = (move[changes - 1] > _FAST * least).any(axis=1)
    sample = float(np.median(np.diff(recording.t)))
    apart = np.maximum(np.rint(np.diff(recording.t[changes]) / sample), 1.0)[fast[1:] & fast[:-1]]
    if len(apart) < _READINGS:
        return recording
    near = apart[apart <= 2.0 * np.median(apart) + 1.0]  # what is farther apart is a rest, or samples that are lost
    every = float(near.mean())
    if every < _HELD or near.sum() < _IN_MOTION * recording.samples:
        return recording
    rates = f"{1.0 / (every * sample):.3g} Hz of {1.0 / sample:.4g} Hz"
    if np.mean(np.abs(apart - every) <= 1.0) < _EVENLY:
        raise InputError(
            f"{recording.source}: positions change once in {every:.3g} samples ({rates}), now after"
            f" {near.min():.0f}, now after {near.max():.0f}: how old the others are isn't told; publish joint states at"
            " the rate at which the encoders are read"
        )
    kept = _readings(changes, every, recording.samples)
    note = (
        f"positions change once in {every:.3g} samples ({rates}): the {recording.samples - int(kept.sum())} samples"
        f" between repeat an older position and are left out; what is kept may still be older than its effort by up to"
        f" {1e3 * sample:.3g} ms: publish joint states at the rate at which the encoders are read"
    )
    return replace(recording[kept], notes=(*recording.notes, note))


def _readings(changes: np.ndarray, every: float, samples: int) -> Mask:
    """Return at which samples [N] positions were read, once in so many: where they change, and between two changes, of
    a joint at rest or slower than its encoder's step, as often as elsewhere.
    """
    kept = np.zeros(samples, dtype=bool)
    for begin, end in zip(changes, np.append(changes[1:], samples), strict=True):
        read = begin + np.rint(every * np.arange(int((end - begin) / every) + 1)).astype(int)
        kept[read[(read == begin) | (read < end - 0.5 * every)]] = True
    before = changes[0] - np.rint(every * np.arange(int(changes[0] / every) + 1)).astype(int)
    kept[before[before >= 0]] = True
    return kept
