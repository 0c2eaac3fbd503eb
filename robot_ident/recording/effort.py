"""From what the drives report as effort to the torque at the joints, as the robot declares it, and back."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from robot_ident.recording.recording import Recording
from robot_ident.recording.unsigned import with_signs
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


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


@dataclass(frozen=True)
class EffortSeries:
    """The effort of one joint: stamps [k] ns, increasing, and values [k], in the unit in which it is reported."""

    stamp: NDArray[np.int64]
    value: Array

    def at(self, t: Array, start: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return it at instants t [N] s since `start` ns, linear between stamps, and whether it is known there.

        It is where there are efforts on both sides, no further apart than `_GAP` usual steps, or one at the instant; up
        to half a step beyond either end it stays what it is there.
        """
        own = (self.stamp - start) / 1e9
        usual = np.median(np.diff(own)) if len(own) > 1 else 0.0
        right = np.clip(np.searchsorted(own, t), 0, len(own) - 1)
        left = np.where(own[right] <= t, right, np.maximum(right - 1, 0))
        inside = (t >= own[0] - 0.5 * usual) & (t <= own[-1] + 0.5 * usual)
        return np.interp(t, own, self.value), inside & (own[right] - own[left] <= _GAP * usual)
