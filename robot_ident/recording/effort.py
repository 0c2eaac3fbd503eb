"""From what the drives report as effort to the torque at the joints, as the robot declares it, and back; efforts that a
driver reports without their sign, and the sign that the motion gives them back.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from robot_ident.errors import InputError
from robot_ident.recording.clock import even_positions, read_clock
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Mask, Motion


def at_the_joints(recording: Recording, robot: Robot, *, motion_only: bool = False) -> Recording:
    """Return a recording whose effort is the torque at the joints, and notes on what was made of it.

    motion_only: its efforts aren't used, so that they may say nothing. Raises InputError where efforts are declared
    unsigned and can't be given a sign.
    """
    if robot.effort.plain(robot.joints):
        return recording
    if not motion_only:
        recording = with_signs(recording, robot)
    tau = joint_torque(recording.tau, recording.q, robot)
    return replace(recording, tau=tau, notes=(*recording.notes, *_notes(robot, _without_gravity(robot))))


def joint_torque(effort: Array, q: Array, robot: Robot) -> Array:
    """Return the torque at the joints [N, n] Nm of what drives report [N, n] at positions q [N, n].

    tau = C (r u), u = K(sign gain reported): K the drive's Nm/A (or its curve) where effort is a current, r the gear
    ratio where it is measured on the motor's shaft, C the coupling; g(q) of the URDF is put back where the driver takes
    gravity out. A drive of unknown gain keeps the unit A.
    """
    if robot.effort.plain(robot.joints):
        return effort
    drives: Array = effort * robot.effort.drives(robot.joints)
    for joint, name in enumerate(robot.joints):
        declared = robot.effort.of(name)
        if declared.quantity == "current":
            drives[:, joint] = _by_drive(drives[:, joint], robot, joint, to_torque=True)
        if declared.side == "motor":
            drives[:, joint] *= robot.drives.gear_ratio[joint]
    tau: Array = drives if robot.effort.coupling is None else np.asarray(drives @ robot.effort.coupling.T)
    removed = _without_gravity(robot)
    return tau + _gravity(robot, q) * removed if removed.any() else tau


def per_reported_ampere(robot: Robot) -> Array:
    """Return by joint [n] what a model has of one reported ampere where no gain is known: A of the other drives, or Nm
    that stand in for it; 1 elsewhere.
    """
    one = np.ones((1, robot.n))
    known = [not robot.in_ampere(joint) for joint in range(robot.n)]
    return np.where(known, 1.0, (joint_torque(one, 0.0 * one, robot) - joint_torque(0.0 * one, 0.0 * one, robot))[0])


def as_reported(torque: Array, q: Array, robot: Robot) -> Array:
    """Return what the drives report [N, n] of a torque at the joints [N, n] Nm: the inverse of `at_the_joints`,
    absolute where they report no sign.
    """
    if robot.effort.plain(robot.joints):
        return torque
    removed = _without_gravity(robot)
    tau: Array = torque - _gravity(robot, q) * removed if removed.any() else np.array(torque)
    if robot.effort.coupling is not None:
        tau = np.asarray(np.linalg.solve(robot.effort.coupling, tau.T).T)
    for joint, name in enumerate(robot.joints):
        declared = robot.effort.of(name)
        if declared.side == "motor":
            tau[:, joint] /= robot.drives.gear_ratio[joint]
        if declared.quantity == "current":
            tau[:, joint] = _by_drive(tau[:, joint], robot, joint, to_torque=False)
    reported = tau / robot.effort.drives(robot.joints)
    unsigned = [robot.effort.of(name).unsigned for name in robot.joints]
    return np.where(unsigned, np.abs(reported), reported)


def _by_drive(x: Array, robot: Robot, joint: int, *, to_torque: bool) -> Array:
    """Return the torque [N] Nm of a current [N] A by the drive's curve or its Nm/A, or the current of a torque.

    Where nobody knows its Nm/A, it is its A over the A of the others.
    """
    curve = robot.torque_curves.get(robot.joints[joint])
    if curve:
        current, torque = np.array([(0.0, 0.0), *curve]).T
        return _along(x, current, torque) if to_torque else _along(x, torque, current)
    known = not robot.in_ampere(joint)
    constant = robot.drives.torque_constant[joint] if known else robot.effort.of(robot.joints[joint]).relative or 1.0
    return x * float(constant) if to_torque else x / float(constant)


def _along(x: Array, given: Array, wanted: Array) -> Array:
    """Return an odd curve through points at x [N], straight beyond the last of them."""
    size = np.abs(x)
    slope = (wanted[-1] - wanted[-2]) / (given[-1] - given[-2])
    return np.asarray(np.sign(x) * (np.interp(size, given, wanted) + np.maximum(size - given[-1], 0.0) * slope))


def _without_gravity(robot: Robot) -> Array:
    """Return 1 for joints whose driver takes gravity out, else 0 [n]."""
    return np.array([float(robot.effort.of(name).gravity == "removed") for name in robot.joints])


def _gravity(robot: Robot, q: Array) -> Array:
    """Return the URDF's gravity torque [N, n] Nm at positions q [N, n]."""
    still = np.zeros_like(q)
    return robot.rigid.inverse_dynamics(Motion(q, still, still))


def _notes(robot: Robot, removed: Array) -> list[str]:
    """Return a line for each thing that was made of the effort."""
    notes = []
    kinds = {name: robot.effort.of(name) for name in robot.joints}
    known = [n for n, kind in kinds.items() if kind.quantity == "current" and n not in robot.ampere_joints]
    if known:
        notes.append("effort taken as current: torque by the drives' gain")
    if robot.ampere_joints:
        notes.append(f"no drive gain is known of {', '.join(robot.ampere_joints)}: results carry the unit A there")
    if removed.any():
        names = [name for name, out in zip(robot.joints, removed, strict=True) if out]
        notes.append(
            f"gravity, which the driver takes out of {', '.join(names)}, is put back from the URDF's masses: what is"
            " found of centres of mass is the URDF's"
        )
    return notes


_GAP = 5.0  # times the usual step between two efforts: what lies further apart is not interpolated


def effort_at(t: Array, start: int, stamp: NDArray[np.int64], value: Array) -> tuple[Array, Mask]:
    """Return an effort at instants t [N] s since `start` ns, linear between its increasing stamps [k] ns and their
    values [k], and whether it is known there.

    It is where there are efforts on both sides, no further apart than `_GAP` usual steps, or one at the instant; up to
    half a step beyond either end it stays what it is there.
    """
    own = (stamp - start) / 1e9
    usual = np.median(np.diff(own)) if len(own) > 1 else 0.0
    right = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
    left = np.where(own[right] <= t, right, np.maximum(right - 1, 0))
    inside = (t >= own[0] - 0.5 * usual) & (t <= own[-1] + 0.5 * usual)
    return np.interp(t, own, value), inside & (own[right] - own[left] <= _GAP * usual)


EXPLAINED = 0.8
"""Share of an effort's power that the motion must explain before anything is said about what the effort is."""

_NEGATIVE = 0.02  # of the largest effort, by which an absolute value that was filtered may fall below zero
_ROUNDS = 20
_BAND = 10.0  # Hz to which positions are differentiated
_SPACING = 0.01  # s between rows at which the URDF's torque is computed
_MOST_UNSURE = 0.25  # of the samples: with more, what the noise folds over is taken for torque
_UNSURE = 2.0  # times what is left over: a torque that the motion makes smaller may have either sign


def folded_back(columns: Array, size: Array) -> tuple[Array, Array]:
    """Return the torque [K] that columns [K, k] (weight, inertia, speed, its sign, ...) make of an effort without a
    sign [K], and what it leaves.

    Least squares and the sign of what they give, in turn, until it stays: from the URDF's torque, and from friction
    alone. What leaves less is taken.
    """
    found = []
    for turn in (np.sign(columns[:, 0] + columns[:, 1]), np.sign(columns[:, 2])):
        for _ in range(_ROUNDS):
            solved, *_ = np.linalg.lstsq(columns, size * turn, rcond=1e-9)
            made = columns @ solved
            left, before, turn = size * turn - made, turn, np.sign(made)
            if np.array_equal(before, turn):
                break
        found.append((made, left))
    return min(found, key=lambda one: float(one[1] @ one[1]))


def one_sided(tau: Array) -> bool:
    """Return whether an effort [K] never changes its sign."""
    sign = np.sign(tau.mean()) or 1.0
    return bool((sign * tau).min() >= -_NEGATIVE * np.abs(tau).max())


def with_signs(recording: Recording, robot: Robot) -> Recording:
    """Return a recording whose efforts that the robot declares unsigned have the sign of what weight, inertia, viscous
    and Coulomb friction and an offset make of them.

    Raises InputError where such an effort changes its sign, or the motion explains too little of it to tell its sign.
    """
    lost = [joint for joint, name in enumerate(robot.joints) if robot.effort.of(name).unsigned]
    if not lost:
        return recording
    clock = read_clock(recording)
    q = even_positions(recording, clock)
    smooth = ZeroPhaseLowPass(min(_BAND, 0.2 / clock.dt), clock.dt, len(q))
    every = max(1, int(_SPACING / clock.dt))
    at, speed, acceleration = (smooth.apply(q, k)[::every] for k in range(3))
    rows = Motion(at, speed, acceleration, dt=clock.dt * every)
    still = np.zeros_like(rows.q)
    weight = robot.rigid.inverse_dynamics(Motion(rows.q, still, still))
    inertial = robot.rigid.inverse_dynamics(rows) - weight
    t = clock.t[0] + clock.dt * every * np.arange(rows.samples)
    tau, notes = np.array(recording.tau), list(recording.notes)
    for joint in lost:
        name, effort = robot.joints[joint], recording.tau[:, joint]
        if not one_sided(effort):
            raise InputError(
                f"{recording.source}: the effort of {name} is declared unsigned, and lies between {effort.min():.4g}"
                f" and {effort.max():.4g}: it has a sign; take effort.unsigned out of the robot YAML"
            )
        size = np.interp(t, recording.t, np.abs(effort))
        dq, ones = rows.dq[:, joint], np.ones(rows.samples)
        parts = (weight[:, joint], inertial[:, joint], dq, np.sign(dq), rows.ddq[:, joint], ones)
        made, left = folded_back(np.column_stack(parts), size)
        share = 1.0 - float(left @ left) / max(float(size @ size), 1e-300)
        if share < EXPLAINED:
            raise InputError(
                f"{recording.source}: the effort of {name} has no sign, and weight, inertia and friction explain"
                f" {100 * share:.0f} % of its square whatever sign it is given ({100 * EXPLAINED:.0f} are needed):"
                " its sign can't be told; record effort with its sign"
            )
        unsure = float(np.mean(np.abs(made) < _UNSURE * np.sqrt(np.mean(left**2))))
        if unsure > _MOST_UNSURE:
            raise InputError(
                f"{recording.source}: the effort of {name} has no sign, and in {100 * unsure:.0f} % of the samples it"
                f" is too near zero to give it one ({100 * _MOST_UNSURE:.0f} % are taken): record a motion with fewer"
                " rests, or effort with its sign"
            )
        tau[:, joint] = np.abs(effort) * np.where(np.interp(recording.t, t, made) < 0.0, -1.0, 1.0)
        notes.append(
            f"the effort of {name} has no sign; it is given that of weight, inertia and friction, which explain"
            f" {100 * share:.1f} % of its square; near zero, in {100 * unsure:.0f} % of the samples, the sign is unsure"
        )
    return replace(recording, tau=tau, notes=tuple(notes))
