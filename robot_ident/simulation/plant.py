"""The simulated arm: rigid links, friction that sticks, springs and servos, advanced in fixed steps without Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask, Motion
from robot_ident.simulation.commands import Commands
from robot_ident.simulation.equations import start_values
from robot_ident.simulation.physics import Physics
from robot_ident.simulation.program import Program, program_of
from robot_ident.simulation.servo import Servo
from robot_ident.simulation.state import Layout

BLOCKS = (64, 8, 1)
"""How many steps one call into compiled code runs; a run of any length is put together from these."""


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
        return self._program.layout

    def rest(self, q: Array) -> Array:
        """Return the state at rest in a pose q [n] that the encoders show."""
        return self.moving(Motion(q[None], np.zeros((1, self.robot.n)), np.zeros((1, self.robot.n))))

    def moving(self, motion: Motion) -> Array:
        """Return the state with one instant's motion, which the encoders show; phenomena are at rest."""
        q, v, a = self._true(motion)
        joints = list(range(self.robot.n)) + [p.joint for p in self.physics if p.shaft]
        own = [value for p in self.physics for value in p.rest()]
        state = self.layout.rest(q[joints], own, start_values(self.physics))
        size = len(joints)
        state[size : 2 * size], state[2 * size : 3 * size] = v[joints], a[joints]
        return state

    def run(self, state: Array, commands: Commands) -> Array:
        """Return the states [N, size] after each of N steps."""
        dry = self._program.dry[: self.robot.n]
        turns = np.any(commands.jump[:, dry] != 0, axis=1)
        out = np.empty((commands.steps, self.layout.size))
        self._blocks(state, commands.rows(), turns, out, BLOCKS)
        return out

    def accelerations(self, states: Array, torque: Array) -> Array:
        """Return ddq [N, n] rad/s^2 at states [N, size] under torques [N, n] Nm: zero where a joint sticks."""
        rests = np.any(self.layout.split(states).v[:, self._program.dry] == 0, axis=1)
        out = np.empty((len(states), self.layout.moving))
        for rows, function in (
            (rests, self._program.acceleration if rests.any() else None),
            (~rests, self._program.moving_acceleration if not rests.all() else None),
        ):
            if function is not None:
                (out[rows],) = function(states[rows], torque[rows])
        return out[:, : self.robot.n]

    def shown(self, states: Array, ddq: Array) -> Motion:
        """Return the motion [N, n] that the encoders show at states [N, size] with accelerations [N, n]."""
        if not self._misread:
            parts = self.layout.joints(states)
            return Motion(parts.q, parts.v, ddq)
        q, dq, ddq = self._program.shown(states, ddq)
        return Motion(q, dq, ddq)

    @cached_property
    def _program(self) -> Program:
        return program_of(self.robot, self.physics, self.servo, self.step)

    @cached_property
    def _misread(self) -> Sequence[Physics]:
        return [p for p in self.physics if p.reads]

    def _true(self, motion: Motion) -> tuple[Array, Array, Array]:
        """Return the true position, velocity and acceleration [n] where encoders show those of an instant."""
        shown, v, a = motion.q[0], motion.dq[0], motion.ddq[0]
        q = np.array(shown)
        if not self._misread:
            return q, v, a
        for _ in range(20):  # an encoder's error is small and smooth: a contraction
            for physics in self._misread:
                q[physics.joint] = shown[physics.joint] - float(physics.misread(q[physics.joint]))
        return q, v, a

    def _blocks(self, state: Array, commands: Array, turns: Mask, out: Array, sizes: tuple[int, ...]) -> None:
        """Fill `out` [N, size] with the states after N steps, in blocks of the largest sizes that fit."""
        at = 0
        for k, size in enumerate(sizes):
            while len(commands) - at >= size:
                part = slice(at, at + size)
                self._block(state, commands[part], turns[part], out[part], sizes[k + 1 :])
                state, at = out[at + size - 1], at + size

    def _block(self, state: Array, commands: Array, turns: Mask, out: Array, smaller: tuple[int, ...]) -> None:
        """Fill `out` [N, size] with the states after the N steps of one block.

        Where no joint with dry friction stops or turns the short way is exact, and its result shows whether that is so.
        Elsewhere smaller blocks tell where in it that happens; those of the last size but one go the long way.
        """
        size, moving, dry = len(commands), self.layout.moving, self._program.dry
        signs = np.sign(state[moving : 2 * moving])[dry]
        if not turns.any() and signs.all():
            self._program.fold("slipping", size).run(state, commands, out)
            if np.all(np.sign(out[:, moving : 2 * moving])[:, dry] == signs):
                return
        if len(smaller) > 1:
            self._blocks(state, commands, turns, out, smaller)
        else:
            self._program.fold("full", size).run(state, commands, out)
