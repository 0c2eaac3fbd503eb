"""The simulated arm: rigid links, friction that sticks, springs and servos, advanced in fixed steps without Python;
what its drives are told, and the exact course that comes of it.

A periodic steady state is simulated once and repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_ident.errors import InputError
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask, Motion
from robot_ident.testbed.equations import Equations, Layout, equations_of
from robot_ident.testbed.phenomena.phenomenon import Physics
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.vectorised import BLOCKS
from robot_ident.trajectories.excitation import Reference


def commands(servo: Servo, half_steps: Motion) -> Array:
    """Return what a servo tells the drives in N steps along a reference given at 0, h/2, ... N h (2 N + 1 instants).

    [N, 5 n], everything at the middle of the step: reference q and dq, mean feed-forward torque [Nm], the jump by which
    it falls, and at which fraction of the step. Its friction compensation c sign(dq_ref) jumps where dq_ref, taken as
    linear over the step, is zero: the jump isn't smeared over the step, nor put off to its end.
    """
    middle, before, after = half_steps[1::2], half_steps.dq[0:-1:2], half_steps.dq[2::2]
    smooth, level = servo.ahead(middle)
    s0, s1 = np.sign(before), np.sign(after)
    turns = s0 * s1 < 0
    span = np.where(turns, before - after, 1.0)
    fraction = np.where(turns, before / span, np.where(s0 == 0, 0.0, 1.0))
    mean = smooth + level * (fraction * s0 + (1 - fraction) * s1)
    return np.hstack([middle.q, middle.dq, mean, level * (s0 - s1), fraction])


@dataclass(frozen=True)
class Plant:
    """A robot with its phenomena and servos, advanced by a time-stepping scheme (Moreau 1988).

    Second order where motion is smooth. Dry friction is set-valued and solved anew in each step, with the instant at
    which a joint stops or turns found inside the step: a joint sticks with velocity exactly zero, and nothing chatters.
    """

    robot: Robot
    physics: tuple[Physics, ...]
    servo: Servo
    step: float

    @cached_property
    def layout(self) -> Layout:
        """Where things stand in a state."""
        return self._equations.layout

    def rest(self, q: Array) -> Array:
        """Return the state at rest in a pose q [n] that the encoders show."""
        return self.moving(Motion(q[None], np.zeros((1, self.robot.n)), np.zeros((1, self.robot.n))))

    def moving(self, motion: Motion) -> Array:
        """Return the state with one instant's motion, which the encoders show; phenomena are at rest."""
        q, v, a = self._true(motion.q[0]), motion.dq[0], motion.ddq[0]
        joints = list(range(self.robot.n)) + [p.joint for p in self.physics if p.shaft]
        own = [value for p in self.physics for value in p.rest()]
        values = [float(p.values[name]) for p in self.physics for name in p.free]
        return np.concatenate([q[joints], v[joints], a[joints], own, values])

    def run(self, state: Array, told: Array) -> Array:
        """Return the states [N, size] after each of N steps with commands `told` [N, 5 n]."""
        n = self.robot.n
        turns = np.any(told[:, 3 * n : 4 * n][:, self._equations.dry[:n]] != 0, axis=1)
        out = np.empty((len(told), self.layout.size))
        self._blocks(state, told, turns, out, BLOCKS)
        return out

    def accelerations(self, states: Array, torque: Array) -> Array:
        """Return ddq [N, n] rad/s^2 at states [N, size] under torques [N, n] Nm: zero where a joint sticks."""
        (out,) = self._equations.acceleration(states, torque)
        return out[:, : self.robot.n]

    def shown(self, states: Array, ddq: Array) -> Motion:
        """Return the motion [N, n] that the encoders show at states [N, size] with accelerations [N, n]."""
        q, dq, ddq = self._equations.shown(states, ddq)
        return Motion(q, dq, ddq)

    @cached_property
    def _equations(self) -> Equations:
        return equations_of(self.robot, self.physics, self.servo, self.step)

    def _true(self, shown: Array) -> Array:
        """Return the true position [n] where encoders show q [n]."""
        q = np.array(shown)
        for _ in range(20):  # an encoder's error is small and smooth: a contraction
            for physics in self.physics:
                if physics.reads:
                    q[physics.joint] = shown[physics.joint] - float(physics.misread(q[physics.joint]))
        return q

    def _blocks(self, state: Array, told: Array, turns: Mask, out: Array, sizes: tuple[int, ...]) -> None:
        """Fill `out` [N, size] with the states after N steps, in blocks of the largest sizes that fit."""
        at = 0
        for k, size in enumerate(sizes):
            while len(told) - at >= size:
                part = slice(at, at + size)
                self._block(state, told[part], turns[part], out[part], sizes[k + 1 :])
                state, at = out[at + size - 1], at + size

    def _block(self, state: Array, told: Array, turns: Mask, out: Array, smaller: tuple[int, ...]) -> None:
        """Fill `out` [N, size] with the states after the N steps of one block.

        Where no joint with dry friction stops or turns the short way is exact, and its result shows whether that is so.
        Elsewhere smaller blocks tell where in it that happens; those of the last size but one go the long way.
        """
        size, moving, dry = len(told), self.layout.moving, self._equations.dry
        signs = np.sign(state[moving : 2 * moving])[dry]
        if not turns.any() and signs.all():
            self._equations.fold("slipping", size)(state, told, out)
            if np.all(np.sign(out[:, moving : 2 * moving])[:, dry] == signs):
                return
        if len(smaller) > 1:
            self._blocks(state, told, turns, out, smaller)
        else:
            self._equations.fold("full", size)(state, told, out)


AT_A_TIME = 16384
"""Steps whose reference is evaluated at a time: bounds the memory that a long motion takes."""

SAME_POSITION, SAME_VELOCITY, SAME_STATE = 1e-9, 1e-8, 1e-6
"""A period repeats when joints return to within this [rad], [rad/s], own states to this part of their range: the
torque that follows from it is a thousandth of an Nm on a large robot, and an encoder's step is ten thousand times
coarser."""


class Steady(NamedTuple):
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
    """States [U, size] at the beginning of steps, and which of them belongs to each step of the course, rows [N]."""

    states: Array
    rows: np.ndarray[tuple[int], np.dtype[np.int64]]


def follow(
    plant: Plant, reference: Callable[[Array], Motion], first: int, steps: int, state: Array
) -> tuple[Array, Array]:
    """Return the states [steps, size] at the beginning of steps from `first` on, and the state [size] after them.

    reference(t [N] s) gives the motion [N, n] to follow.
    """
    out = np.empty((steps, plant.layout.size))
    for begin in range(0, steps, AT_A_TIME):
        count = min(AT_A_TIME, steps - begin)
        half = np.arange(2 * (first + begin), 2 * (first + begin + count) + 1)
        # A product with an integer, so that a step's times don't depend on where the run began.
        motion = reference(np.asarray(half * (plant.step / 2), dtype=float))
        after = plant.run(state, commands(plant.servo, motion))
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
        states, _ = follow(plant, reference.reference, 0, steps + extra, state)
        return Trace(states, np.arange(steps + extra))
    states, state = follow(plant, reference.reference, 0, transient, state)
    parts, at = [states], transient
    for done in range(steady.periods):
        states, after = follow(plant, reference.reference, at, period, state)
        parts.append(states)
        if repeats(plant, state, after, np.ptp(states, axis=0)):
            again = np.tile(np.arange(at, at + period), steady.periods - done - 1)
            more = at + np.arange(extra) % period
            rows = np.concatenate([np.arange(at + period), again, more])
            return Trace(np.concatenate(parts), rows)
        state, at = after, at + period
    return Trace(np.concatenate(parts), np.concatenate([np.arange(at), at - period + np.arange(extra) % period]))


def repeats(plant: Plant, before: Array, after: Array, span: Array) -> bool:
    """Return whether the state after a period is the one before it.

    The acceleration of the last step is left out: it only serves a prediction.
    """
    change, over = plant.layout.split(np.abs(after - before)), plant.layout.split(span)
    same_motion = np.all(change.q <= SAME_POSITION) and np.all(change.v <= SAME_VELOCITY)
    return bool(same_motion and np.all(change.own <= SAME_STATE * over.own))
