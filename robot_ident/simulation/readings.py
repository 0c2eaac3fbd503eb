"""What a course of the plant is at its samples: the true motion, what the encoders show, what the drives report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.reference import Reference
from robot_ident.signals.motion import Array, Motion
from robot_ident.simulation.link_sensor import link_side, link_torque
from robot_ident.simulation.physics import Physics
from robot_ident.simulation.plant import Plant
from robot_ident.simulation.trace import Trace

Steps = np.ndarray[Any, np.dtype[np.int64]]


@dataclass(frozen=True)
class Readings:
    """Arrays [N, n] at the samples, without noise.

    q, dq, ddq: true motion of the joints. shown_q, shown_dq, shown_ddq: that of the encoders. torque: of the drives.
    recorded: what is measured of it where the robot measures, late or early. fine: that at every step, None unless it
    was asked for.
    """

    q: Array
    dq: Array
    ddq: Array
    shown_q: Array
    shown_dq: Array
    shown_ddq: Array
    torque: Array
    recorded: Array
    fine: Array | None = None


FIELDS = ("q", "dq", "ddq", "shown_q", "shown_dq", "shown_ddq", "torque", "recorded")


def blend(start: Readings, ends: Sequence[tuple[Readings, Array]]) -> Readings:
    """Return readings that go from a start toward ends, each by a share [N] at each sample of its own."""
    values = {name: getattr(start, name).copy() for name in FIELDS}
    fine = None if start.fine is None else start.fine.copy()
    for end, share in ends:
        for name, value in values.items():
            value += share[:, None] * (getattr(end, name) - getattr(start, name))
        if fine is not None and start.fine is not None and end.fine is not None:
            at = np.arange(len(fine)) * (len(share) / len(fine))
            fine += np.interp(at, np.arange(len(share)), share)[:, None] * (end.fine - start.fine)
    return Readings(**values, fine=fine)


def extra_steps(physics: Sequence[Physics], step: float) -> int:
    """Return how many steps after the last sample its torque is from, where it is recorded early."""
    return int(np.ceil(max([0.0, *(-p.lateness() for p in physics)]) / step)) + 1


def lateness(physics: Sequence[Physics], joints: int) -> Array:
    """Return by how much each joint's torque is late [n] s."""
    late = np.zeros(joints)
    for p in physics:
        late[slice(None) if p.place is None else p.joint] += p.lateness()
    return late


def read(
    plant: Plant,
    reference: Reference,
    course: Trace,
    per_sample: int,
    samples: int,
    *,
    fine: bool = False,
    periodic: bool = False,
) -> Readings:
    """Return the readings at `samples` samples of a course; those of repeated periods are computed once.

    periodic: the course is a whole period, before and after which it repeats.
    """
    steps, which = np.unique(course.rows[: samples * per_sample : per_sample], return_inverse=True)
    states = course.states[steps]
    torque = _drives(plant, reference, states, steps)
    ddq = plant.accelerations(states, torque)
    shown = plant.shown(states, ddq)
    parts = plant.layout.joints(states)
    recorded = torque[which]
    late, every = lateness(plant.physics, plant.robot.n), None
    if fine or late.any():
        whole = _drives(plant, reference, course.states, np.arange(len(course.states)))
        every = _shifted(whole, course.rows, late / plant.step, periodic)[: samples * per_sample]
        recorded = every[::per_sample]
    sensed = link_side(plant.robot)
    if sensed:
        if fine or late[sensed].any():
            raise InputError("a filter or a delay can't be simulated where effort is measured on the link side")
        recorded = np.array(recorded)
        links = link_torque(plant.robot, plant.physics, Motion(parts.q, parts.v, ddq))
        recorded[:, sensed] = links[which][:, sensed]
    values = (parts.q, parts.v, ddq, shown.q, shown.dq, shown.ddq, torque)
    at_samples = dict(zip(FIELDS, (value[which] for value in values), strict=False))
    return Readings(**{**at_samples, "recorded": recorded}, fine=every if fine else None)


def _drives(plant: Plant, reference: Reference, states: Array, steps: Steps) -> Array:
    """Return the drives' torque [U, n] at states of given steps."""
    wanted = reference.reference(np.asarray(steps * plant.step, dtype=float))
    shown = plant.shown(states, np.zeros(wanted.q.shape))
    return plant.servo.torque(wanted, shown.q, shown.dq)


def _shifted(torque: Array, rows: Steps, late: Array, periodic: bool) -> Array:
    """Return the torque [N, n] of steps `rows`, each joint's late by a number of steps, linear between steps."""
    out = np.empty((len(rows), torque.shape[1]))
    at = np.arange(len(rows), dtype=float)
    for j, delay in enumerate(late):
        out[:, j] = np.interp(at - delay, at, torque[rows, j], period=len(rows) if periodic else None)
    return out
