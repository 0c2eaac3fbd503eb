"""The arm's own share of a measured torque: less a known payload, as the base stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robot_ident.model.base_parameters import reduce_to_base
from robot_ident.recording.conditions import Conditions, KnownPayload
from robot_ident.recording.measurement import Measurement
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


def arm_alone(measured: Measurement, conditions: Conditions, robot: Robot) -> Measurement:
    """Return a measurement whose torque is that of the arm itself, so that recordings share its parameters.

    tau - Y_last pi_payload of a known payload. With another gravity than the robot's the motion carries it, and what
    the URDF's inertias need there beyond its base parameters is taken off: no recording in the usual pose shows it.
    At drives of unknown gain the payload stays: it is what tells the gain.
    """
    motion = measured.motion
    if conditions.gravity is not None:
        motion = replace(motion, gravity=conditions.gravity)
    extra = beyond_base(motion, robot) + _of_payload(conditions, motion, robot)
    notes = conditions.notes(off=bool(robot.compares_with_newton_metres.any()))
    if conditions.assumed:
        notes = tuple(f"{measured.source}: {note}" for note in notes)
    alone = _less(measured, extra)
    return replace(alone, motion=motion, notes=(*measured.notes, *notes), conditions=conditions)


def beyond_base(motion: Motion, robot: Robot) -> Array:
    """Return the torque [N, n] Nm that the URDF's links need beyond what their base parameters say, where a motion has
    another gravity than the robot; 0 elsewhere. `arm_alone` takes it off.
    """
    if motion.gravity is None:
        return np.zeros_like(motion.q)
    base = reduce_to_base(robot)
    columns = robot.rigid.regressor(motion)
    known = base.values(robot.rigid.parameters, np.zeros(robot.n))
    return np.asarray(columns @ robot.rigid.parameters - columns[:, :, list(base.columns)] @ known)


def with_payload(measured: Measurement, robot: Robot) -> Measurement:
    """Return a measurement of `arm_alone` with the torque of its known payload in it, as it was measured."""
    return _less(measured, -_of_payload(measured.conditions, measured.motion, robot))


def less_payload(measured: Measurement, payload: KnownPayload | None, robot: Robot) -> Measurement:
    """Return a measurement of `arm_alone` with the torque of another payload taken off than what was taken off before,
    None: with its payload in it.
    """
    conditions = replace(measured.conditions, payload=payload)
    whole = with_payload(measured, robot)
    return replace(_less(whole, _of_payload(conditions, measured.motion, robot)), conditions=conditions)


def _less(measured: Measurement, torque: Array) -> Measurement:
    """Return a measurement less a torque [N, n] Nm, in its mean and in every period."""
    single = measured.period_torque
    return replace(measured, torque=measured.torque - torque, period_torque=None if single is None else single - torque)


def _of_payload(conditions: Conditions, motion: Motion, robot: Robot) -> Array:
    """Return the torque [N, n] Nm of a known payload at the drives whose effort compares with it."""
    known = robot.compares_with_newton_metres
    if conditions.payload is None or not known.any():
        return np.zeros_like(motion.q)
    return np.asarray(known * conditions.payload.torque(robot, motion))
