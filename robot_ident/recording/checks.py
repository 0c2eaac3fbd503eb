"""What in a recording can't be right, or tells nothing.

Samples of its own, of one robot, in SI units, an effort of its own for each joint; copies of another recording and
repetitions of its motion; joints that stand still, as declared or not; a payload that no model of the robot can hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.clock import roughness
from robot_ident.recording.conditions import Conditions, in_metres, sidecar
from robot_ident.recording.measurement import Measurement
from robot_ident.recording.period import AT_REST, longest_run
from robot_ident.recording.recording import Recording
from robot_ident.recording.resolution import position_step
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask

_MOVES = 1e-3  # rad or m, from which on a joint has moved
_STEPS = 20  # of an encoder; within fewer a joint at rest may flicker
_STRAIGHT = 1e-6  # of a signal's range: no sensor measures three samples so exactly on one line
_MOSTLY = 0.5  # of the samples
_ROUNDED = 1.5  # steps by which a straight line bends that is rounded to them
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
    leapt = np.column_stack([_leapt(q) for q in recording.q.T])
    lost: Mask = np.any(leapt, axis=1)
    if not lost.any() or lost.mean() > _FEW:
        return recording
    first = int(np.argmax(lost))
    joints = [name for name, some in zip(recording.names, leapt.T, strict=True) if some.any()]
    size = float(np.abs(np.diff(recording.q, axis=0)[first - 1]).max())
    note = (
        f"positions of {', '.join(joints)} leap by up to {size:.3g} and back in {int(lost.sum())} samples, first at"
        f" {recording.t[first]:.3f} s; these are left out: look for readings that the driver lost"
    )
    return replace(recording[~lost], notes=(*recording.notes, note))


def _leapt(q: Array) -> Mask:
    """Return which samples [N] of a joint's positions lie between a leap and one back."""
    out = np.zeros(len(q), dtype=bool)
    if len(q) <= 20:
        return out
    steps = np.diff(q)
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
    where it is no such signal. What stands on steps lies on lines at steady speed and bends by one step.
    """
    columns = [column for column in signal.T if np.ptp(column) > _MOVES]
    if len(t) < 50 or not columns:
        return None
    steps = np.diff(t)
    shorter = np.minimum(steps[1:], steps[:-1])
    straight, moving = np.ones((2, len(t) - 2), dtype=bool)
    rounded = np.ones(len(t) - 2, dtype=bool)
    for column, step in zip(columns, position_step(np.stack(columns, axis=1)), strict=True):
        change = np.diff(column) / np.ptp(column)
        bend = np.abs(np.diff(change / steps)) * shorter
        straight &= bend < _STRAIGHT
        moving &= np.abs(change[1:]) > 10.0 * _STRAIGHT
        rounded &= bend < max(_STRAIGHT, _ROUNDED * step / np.ptp(column))
    bent = ~straight
    if straight[moving].sum() <= _MOSTLY * len(straight) or rounded[bent].sum() > _MOSTLY * bent.sum():
        return None
    apart = np.diff(np.flatnonzero(bent))
    apart = apart[apart > 1]  # a measured sample between two of the grid bends at both
    if len(apart) < 10 or np.mean(np.abs(apart - np.median(apart)) <= 1.0) < _REGULAR:
        return None
    return np.concatenate([[False], bent & np.concatenate([[True], straight[:-1]]), [False]])


_BEYOND = 3.0  # positions this many times beyond the limits can't be this robot in SI units
_TOO_FAST = 10.0  # speeds this many times beyond the limits
_MOVING = 0.02  # rad or m; a joint that has moved as far has felt friction, if nothing else
_CONSTANT = 1e-9  # share of an effort within which it is one number, rounded


def check_plausible(recording: Recording, robot: Robot) -> None:
    """Raise InputError where positions or torques contradict the robot's limits by a factor, or nothing moves; torque
    at the joints. See `check_efforts` for efforts that say nothing.
    """
    reach = np.maximum(np.abs(robot.limits.lower), np.abs(robot.limits.upper))
    size = np.maximum(recording.q.max(axis=0), -recording.q.min(axis=0))
    for joint in np.flatnonzero(np.isfinite(reach) & (reach > 0) & (size > _BEYOND * reach)).tolist():
        unit = "m: millimetres instead of metres?" if robot.prismatic[joint] else "rad: degrees instead of radians?"
        raise InputError(
            f"{recording.source}: {robot.joints[joint]} reaches {size[joint]:.4g},"
            f" its limit is {reach[joint]:.4g} {unit}"
        )
    _check_speed(recording, robot)
    torque = np.maximum(recording.tau.max(axis=0), -recording.tau.min(axis=0))
    for joint, limit in enumerate(robot.limits.torque):
        if np.isfinite(limit) and torque[joint] > 20.0 * limit and not robot.in_ampere(joint):
            raise InputError(
                f"{recording.source}: the torque of {robot.joints[joint]} reaches {torque[joint]:.4g}, its limit is"
                f" {limit:.4g} {robot.torque_unit(joint)}: wrong units?"
            )
    if np.all(np.ptp(recording.q, axis=0) < 1e-6):
        raise InputError(f"{recording.source}: no joint moves; nothing can be identified from rest")


def silent_efforts(recording: Recording) -> dict[str, float]:
    """Return the joints that move while their effort is one number, and the number: nobody measured it."""
    moves = np.ptp(recording.q, axis=0) > _MOVING
    highest, lowest = recording.tau.max(axis=0), recording.tau.min(axis=0)
    same = highest - lowest <= _CONSTANT * np.maximum(highest, -lowest)
    return {
        name: float(recording.tau[0, joint])
        for joint, name in enumerate(recording.names)
        if moves[joint] and same[joint]
    }


def silent_note(silent: Mapping[str, float]) -> str:
    """Return what `silent_efforts` found, in words; empty where it found nothing."""
    if not silent:
        return ""
    which = ", ".join(f"{name} is {value:g}" for name, value in silent.items())
    moves, none = ("it moves", "its driver") if len(silent) == 1 else ("they move", "their drivers")
    return f"the effort of {which} in every sample, though {moves}: {none} publish{'es' * (len(silent) == 1)} none"


def check_efforts(recording: Recording) -> None:
    """Raise InputError where the effort of a joint that moves is one number, as read: what is fitted to it is nothing.

    The way out is a recording in which that joint stands still, since its motion moves the others.
    """
    if np.all(recording.tau == 0.0):
        raise InputError(f"{recording.source}: every torque is zero; the driver publishes no effort")
    silent = silent_efforts(recording)
    if silent:
        others = ",".join(name for name in recording.names if name not in silent)
        way = f"; record with {', '.join(silent)} standing still, and identify --joints {others}" if others else ""
        raise InputError(f"{recording.source}: {silent_note(silent)}{way}")


def _check_speed(recording: Recording, robot: Robot) -> None:
    """Raise InputError where a joint moves a tenth of the time at speeds that no joint of this robot has."""
    step = max(1, recording.samples // 1000)
    t, q = recording.t[::step], recording.q[::step]
    if len(t) < 20:
        return
    usual = np.percentile(np.abs(np.diff(q, axis=0)) / np.diff(t)[:, None], 90.0, axis=0)
    for joint, limit in enumerate(robot.limits.velocity):
        if np.isfinite(limit) and usual[joint] > _TOO_FAST * limit:
            unit = "m/s" if robot.prismatic[joint] else "rad/s"
            raise InputError(
                f"{recording.source}: {robot.joints[joint]} moves at {usual[joint]:.4g} {unit}, its limit is"
                f" {limit:.4g}: wrong units of position or time?"
            )


_ONE_NOISE = 0.25  # of the variance by which two measurements differ: two of one noise differ by less
_SAME_ROWS = 0.3  # share of the rows of a recording that stand in another one to the last digit
_ALIKE = 0.05  # of a motion's rms, by which repetitions of it may differ
_PRINTED = 1e-6  # rad or m: the last of six decimals, which single precision keeps as well


def refuse_copies(measurements: Sequence[Measurement]) -> None:
    """Raise InputError where two measurements hold the same torques and positions, as a recording under two names does.

    To the last digit; or, rounded or trimmed, their noise: what is measured again differs by 2 sigma^2 in the mean. A
    torque that was commanded may be the same twice, on one motion or on two; the positions that were measured with it
    are not.
    """
    for one, other in combinations(measurements, 2):
        later = _later(one, other)
        if one is other or (later is not None and _of_one_path(one, other, later)):
            raise InputError(
                f"{other.source} holds the samples of {one.source}: a copy of it, or a simulation of the"
                " same motion without noise; give every one once, since the noise of both would be counted as"
                " independent, and what is kept aside as not seen"
            )


def _later(one: Measurement, other: Measurement) -> int | None:
    """Return by how many rows two measurements of the same torques are apart; None where the torques are not the same.

    Averaged periods are the same where they differ by far less than their noise, wherever in a period each began:
    min over shifts s of mean_t (a_j(t) - b_j(t - s))^2 / sigma_j^2, from the cross spectrum. The noise of one pass is
    what it has from sample to sample.
    """
    if np.array_equal(one.torque, other.torque, equal_nan=True):
        return 0
    if one.torque.shape != other.torque.shape or (one.base_frequency is None) != (other.base_frequency is None):
        return None
    if one.base_frequency is None:
        limit = _ONE_NOISE * (roughness(one.torque) ** 2 + roughness(other.torque) ** 2)
        return 0 if np.all(np.mean((one.torque - other.torque) ** 2, axis=0) <= limit) else None
    sigma = np.sqrt(one.torque_variance / one.averages + other.torque_variance / other.averages)
    if not np.all(np.isfinite(sigma) & (sigma > 0.0)):
        return None
    a, b = (np.nan_to_num(measured.torque / sigma) for measured in (one, other))
    lines = (np.fft.rfft(a, axis=0) * np.fft.rfft(b, axis=0).conj()).sum(axis=1)
    along = np.fft.irfft(lines, len(a))
    apart = np.sum(a**2) + np.sum(b**2) - 2.0 * along.max()
    return int(np.argmax(along)) if apart < _ONE_NOISE * a.size else None


def _of_one_path(one: Measurement, other: Measurement, later: int) -> bool:
    """Return whether the positions of two measurements of the same torques, so many rows apart, are the same but for
    rounding: by far less than their noise, where it is known, and what printing the one more coarsely makes of it.

    Periods that begin between two samples are shifted by the part of one that brings them together.
    """
    a, b = one.motion.q, other.motion.q
    if a.shape != b.shape:
        return False
    if one.base_frequency is not None and other.base_frequency is not None:
        lines, k = np.fft.rfft(b, axis=0), np.arange(len(b) // 2 + 1)[:, None]
        shift = float(later)
        for _ in range(3):
            turned = lines * np.exp(-2j * np.pi * k * shift / len(b))
            b = np.fft.irfft(turned, len(a), axis=0)
            slope = np.fft.irfft(turned * (2j * np.pi * k / len(a)), len(a), axis=0)
            shift -= float(np.sum((a - b) * slope) / max(float(np.sum(slope**2)), 1e-300))
        b = np.fft.irfft(lines * np.exp(-2j * np.pi * k * shift / len(b)), len(a), axis=0)
    steps = [np.zeros(a.shape[1]) if x.position_step is None else x.position_step for x in (one, other)]
    # what rounding makes may be several times its mean on a few lines, another noise hardly falls to a part of its own
    rounding = (np.abs(steps[0] ** 2 - steps[1] ** 2) + _PRINTED**2) / 12.0 / _ONE_NOISE
    limit = _ONE_NOISE * (_row_variance(one) + _row_variance(other)) + rounding
    return bool(np.all(np.mean((a - b) ** 2, axis=0) <= _kept(one) * limit))


def _row_variance(measured: Measurement) -> Array:
    """Return the noise variance [n] of a row of averaged positions, 0 where it isn't known."""
    variance = measured.averaged_position_variance
    return np.nan_to_num(measured.position_variance / measured.averages if variance is None else variance)


def _kept(measured: Measurement) -> Array:
    """Return the share [n] of white noise that the lines of the motion keep, 1 where it isn't made of lines.

    Of N rows, the lines k with the shares w_k keep (w_0^2 + 2 sum w_k^2) / N.
    """
    share = measured.line_share
    if share is None:
        return np.ones(len(measured.joints))
    return np.asarray((2.0 * np.sum(share**2, axis=0) - share[0] ** 2) / measured.motion.samples)


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
    a, b = (  # the lines of both as if they had been sampled as coarsely as the coarser one
        np.fft.rfft(measured.motion.q / unit, axis=0)[: samples // 2 + 1] * (samples / measured.motion.samples)
        for measured in (one, other)
    )
    along: Array = np.fft.irfft((a * b.conj()).sum(axis=1), samples)
    whole: Array = np.fft.irfft((a * a.conj() + b * b.conj()).sum(axis=1), samples)
    return bool(whole[0] - 2.0 * along.max() <= _ALIKE**2 * samples * len(unit))


def silent_joints(measurements: Sequence[Measurement]) -> Mask:
    """Return which joints [n] have no row that counts in any of some measurements, or stand still in all."""
    reach = np.max([np.ptp(measured.motion.q, axis=0) for measured in measurements], axis=0)
    told = np.any([measured.used[measured.rows].any(axis=0) for measured in measurements], axis=0)
    return np.asarray((reach < AT_REST) | ~told)


def still_notes(measured: Measurement) -> list[str]:
    """Return a line for each joint of which no row of a measurement counts."""
    return [
        f"{name} {'stands still' if far < AT_REST else 'moves no faster than its noise'} in {measured.source}: what its"
        " friction does there no model tells, and no verdict counts it"
        for name, far, yes in zip(
            measured.joints, np.ptp(measured.motion.q, axis=0), silent_joints([measured]), strict=True
        )
        if yes
    ]


def refuse_silent(measurements: Sequence[Measurement], remedy: str = "") -> None:
    """Raise InputError where a joint has no row that counts in any of some measurements, or stands still in all.

    remedy: what to do about it, with `{moving}` in the place of the other joints.
    """
    joints, still = measurements[0].joints, silent_joints(measurements)
    silent = [name for name, yes in zip(joints, still, strict=True) if yes]
    if not silent:
        return
    moving = [name for name in joints if name not in silent]
    hint = remedy.format(moving=",".join(moving)) if moving else ""
    source = ", ".join(measured.source for measured in measurements)
    raise InputError(
        f"{source}: {silent[0]} has no usable sample (it stands still, or is slower than the minimum speed){hint}"
    )


STILL = 0.01  # rad or m: a joint that strays less stands still
_LEAST = 0.3  # of a recording: where joints stand still for less, they aren't held


def held_angles(recording: Recording, held: Sequence[str], given: Mapping[str, float]) -> dict[str, float]:
    """Return the angle [rad, m] at which each joint stands most of the time, or the given one where it isn't recorded.

    Raises InputError where neither tells, or where they contradict each other.
    """
    out = {}
    for name in held:
        if name not in recording.names:
            if name not in given:
                raise InputError(
                    f"{recording.source}: {name} is to be held but is not in the recording;"
                    f" say where it stood: --hold {name}=ANGLE"
                )
            out[name] = float(given[name])
            continue
        angle = float(np.median(recording.q[:, recording.names.index(name)]))
        if name in given and abs(angle - given[name]) > STILL:
            raise InputError(f"{recording.source}: {name} stands at {angle:.4g}, not at {given[name]:.4g} (--hold)")
        out[name] = angle
    return out


def still_part(recording: Recording, angles: Mapping[str, float], instead: str = "name it in --joints") -> Recording:
    """Return the longest stretch of a recording in which every joint of `angles` stands there; what was left out is in
    its notes.

    Raises InputError where that is less than a third of it: those joints are not held. instead: what to do then.
    """
    there = [name for name in angles if name in recording.names]
    if not there:
        return recording
    away = {name: np.abs(recording.q[:, recording.names.index(name)] - angles[name]) > STILL for name in there}
    still = ~np.any(list(away.values()), axis=0)
    first, last = longest_run(still)
    if last - first < _LEAST * recording.samples:
        worst = max(away, key=lambda name: int(away[name].sum()))
        reach = float(np.ptp(recording.q[:, recording.names.index(worst)]))
        raise InputError(
            f"{recording.source}: {worst} is to be held but moves by {reach:.3g}; {instead}, or cut the"
            " recording to where it stands still"
        )
    if last - first == recording.samples:
        return recording
    lost = recording.duration - float(recording.t[last - 1] - recording.t[first])
    part = recording[slice(first, last)]
    return replace(part, notes=(*part.notes, f"{lost:.3g} s left out in which {', '.join(there)} moved"))


_SMALL = 0.1  # m; a robot without links between its joints, a slide say, has no reach that tells anything
_HEAVIEST = 5000.0  # kg; the strongest arms lift half of that


def refuse_payload(conditions: Conditions, robot: Robot, source: Path | str) -> None:
    """Raise InputError where a stated payload can't be the robot's: its centre lies farther from the flange than the
    arm is long, or a joint on the way to the flange follows another one and stands still in the model.
    """
    payload = conditions.payload
    if payload is None and not conditions.estimated:
        return
    centre = payload.centre if payload is not None else conditions.part.centre
    file, reach = sidecar(source), reach_of(robot)
    if payload is not None and payload.mass > _HEAVIEST:
        raise InputError(f"{file}: payload.mass = {payload.mass:g} kg: no robot carries that")
    if centre is not None and _SMALL < reach < np.linalg.norm(centre):
        raise InputError(f"{file}: {in_metres(centre)} (the whole arm is {reach:.2g} m long)")
    following = followers(robot)
    if following:
        s = "s" * (len(following) == 1)
        raise InputError(
            f"{file}: the model of {robot.name} can't hold a payload: on the way to the flange {', '.join(following)}"
            f" follow{s} another joint (mimic: a parallelogram or a belt) and stand{s} still in it; give recordings"
            " without a payload"
        )


def reach_of(robot: Robot) -> float:
    """Return how long the arm is from its first joint to the end effector [m], sliding joints pushed in."""
    model = robot.rigid.model
    steps = [float(np.linalg.norm(model.jointPlacements[k].translation)) for k in range(2, robot.n + 1)]
    flange = model.frames[model.getFrameId(robot.end_effector)].placement.translation
    return sum(steps) + float(np.linalg.norm(flange))


def followers(robot: Robot) -> list[str]:
    """Return the joints on the way to the end effector that follow one that moves, in the order of the chain."""
    if robot.definition is None or not robot.following:
        return []
    joints = list(ElementTree.fromstring(robot.definition.urdf).iterfind("joint"))
    above = {one.get("link", ""): joint for joint in joints if (one := joint.find("child")) is not None}
    named = {joint.get("name", ""): link for link, joint in above.items()}
    link, out = named.get(robot.end_effector, robot.end_effector), []
    while link in above:
        joint = above.pop(link)
        if joint.get("name", "") in robot.following:
            out.append(joint.get("name", ""))
        parent = joint.find("parent")
        link = "" if parent is None else parent.get("link", "")
    return out[::-1]
