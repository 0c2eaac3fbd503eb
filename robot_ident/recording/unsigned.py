"""Efforts that a driver reports without their sign, and the sign that the motion gives them back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.errors import InputError
from robot_ident.recording.clock import even_positions, read_clock
from robot_ident.recording.recording import Recording
from robot_ident.robot.robot import Robot
from robot_ident.signals.filters import ZeroPhaseLowPass
from robot_ident.signals.motion import Array, Motion

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
