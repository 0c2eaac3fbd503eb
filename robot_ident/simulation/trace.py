"""The exact course of a simulation: states at every step, a periodic steady state simulated once and repeated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robot_ident.errors import InputError
from robot_ident.excitation.reference import Reference
from robot_ident.signals.motion import Array
from robot_ident.simulation.commands import Commands
from robot_ident.simulation.plant import Plant

AT_A_TIME = 16384
"""Steps whose reference is evaluated at a time: bounds the memory that a long motion takes."""

SAME_POSITION, SAME_VELOCITY, SAME_STATE = 1e-9, 1e-8, 1e-6
"""A period repeats when joints return to within this [rad], [rad/s], own states to this part of their range: the
torque that follows from it is a thousandth of an Nm on a large robot, and an encoder's step is ten thousand times
coarser."""


@dataclass(frozen=True)
class Steady:
    """A periodic part: after `transient` [s] come `periods` of length `period` [s]."""

    transient: float
    period: float
    periods: int

    @property
    def end(self) -> float:
        """When the last period ends [s]."""
        return self.transient + self.periods * self.period


@dataclass(frozen=True)
class Trace:
    """States [U, size] at the beginning of steps, and which of them belongs to each step of the whole course, rows [N].

    `settled` [s] is when the steady state began that was repeated, None where every period was simulated.
    """

    states: Array
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]
    settled: float | None = None


def follow(plant: Plant, reference: Reference, first: int, steps: int, state: Array) -> tuple[Array, Array]:
    """Return the states [steps, size] at the beginning of steps from `first` on, and the state [size] after them."""
    out = np.empty((steps, plant.layout.size))
    for begin in range(0, steps, AT_A_TIME):
        count = min(AT_A_TIME, steps - begin)
        half = np.arange(2 * (first + begin), 2 * (first + begin + count) + 1)
        # A product with an integer, so that a step's times don't depend on where the run began.
        motion = reference.reference(np.asarray(half * (plant.step / 2), dtype=float))
        after = plant.run(state, Commands.of(plant.servo, motion))
        out[begin], out[begin + 1 : begin + count] = state, after[:-1]
        state = after[-1]
        if not np.isfinite(state).all():
            bad = begin + int(np.argmin(np.isfinite(after).all(axis=1)))
            raise InputError(
                f"the simulated robot {plant.robot.name} leaves all bounds at t = {(first + bad) * plant.step:.3f} s;"
                f" check the values of its effects ({', '.join(p.label for p in plant.physics)}) and the motion"
            )
    return out, state


def _whole(time: float, step: float) -> int | None:
    """Return how many steps a time is, None when it isn't a whole number."""
    count = round(time / step)
    return count if abs(count * step - time) < 1e-6 * step * max(count, 1) else None


def trace(plant: Plant, reference: Reference, steps: int, steady: Steady | None, extra: int = 0) -> Trace:
    """Return the course of `steps` steps, and `extra` ones after them, from rest at the reference's start.

    Of a steady part only as many periods are simulated as its state takes to repeat; all of them where a period isn't
    a whole number of steps.
    """
    state = plant.rest(reference.start_pose)
    transient = None if steady is None else _whole(steady.transient, plant.step)
    period = None if steady is None else _whole(steady.period, plant.step)
    if steady is None or transient is None or period is None:
        states, _ = follow(plant, reference, 0, steps + extra, state)
        return Trace(states, np.arange(steps + extra))
    states, state = follow(plant, reference, 0, transient, state)
    parts, at = [states], transient
    for done in range(steady.periods):
        states, after = follow(plant, reference, at, period, state)
        parts.append(states)
        if repeats(plant, state, after, np.ptp(states, axis=0)):
            again = np.tile(np.arange(at, at + period), steady.periods - done - 1)
            more = at + np.arange(extra) % period
            rows = np.concatenate([np.arange(at + period), again, more])
            return Trace(np.concatenate(parts), rows, at * plant.step)
        state, at = after, at + period
    return Trace(np.concatenate(parts), np.concatenate([np.arange(at), at - period + np.arange(extra) % period]))


def repeats(plant: Plant, before: Array, after: Array, span: Array) -> bool:
    """Return whether the state after a period is the one before it.

    The acceleration of the last step is left out: it only serves a prediction.
    """
    change, over = plant.layout.split(np.abs(after - before)), plant.layout.split(span)
    same_motion = np.all(change.q <= SAME_POSITION) and np.all(change.v <= SAME_VELOCITY)
    return bool(same_motion and np.all(change.own <= SAME_STATE * over.own))
