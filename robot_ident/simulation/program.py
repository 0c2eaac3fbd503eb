"""The compiled step of a simulated robot, made once for all values of its parameters."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array
from robot_ident.simulation.equations import Equations
from robot_ident.simulation.physics import Physics
from robot_ident.simulation.servo import Servo
from robot_ident.simulation.vectorised import Vectorised

KEPT = 48
"""Programs that stay in memory: a study varies values more often than equations."""


class Folded:
    """A step function folded into one that runs several steps on numpy's memory, without Python between them."""

    def __init__(self, buffer: Any, evaluate: Any) -> None:
        """Hold what CasADi's `Function.buffer` returns."""
        self._buffer = buffer
        self._evaluate = evaluate

    @classmethod
    def of(cls, step: Any, size: int) -> Folded:
        """Fold (state, command) -> state over `size` steps."""
        return cls(*step.mapaccum(f"{step.name()}_{size}", size).buffer())

    def run(self, state: Array, commands: Array, out: Array) -> None:
        """Fill `out` [N, size] with the states after each of N steps; commands and out contiguous."""
        start = np.array(state)  # CasADi keeps the address alone: this array must live until the call is over
        self._buffer.set_arg(0, memoryview(start))
        self._buffer.set_arg(1, memoryview(commands))
        self._buffer.set_res(0, memoryview(out))
        self._evaluate()


class Program:
    """The functions of `Equations`, each made when it is first needed."""

    def __init__(self, equations: Equations) -> None:
        """Hold the equations."""
        self.equations = equations
        self.layout = equations.layout
        self._folded: dict[tuple[str, int], Folded] = {}

    @cached_property
    def dry(self) -> Any:
        """Which coordinates have dry friction [moving]."""
        return np.array(self.equations.dry_joints())

    @cached_property
    def full(self) -> Any:
        """The step with stick, slip and turning in it."""
        return self.equations.full()

    @cached_property
    def slipping(self) -> Any:
        """The step in which nothing with dry friction stops or turns."""
        return self.equations.slipping()

    def fold(self, kind: str, size: int) -> Folded:
        """Return the step `full` or `slipping`, folded over `size` steps."""
        if (kind, size) not in self._folded:
            self._folded[kind, size] = Folded.of(getattr(self, kind), size)
        return self._folded[kind, size]

    @cached_property
    def acceleration(self) -> Vectorised:
        """(state, torque) -> ddq at instants at which joints may be at rest."""
        return Vectorised(self.equations.acceleration())

    @cached_property
    def moving_acceleration(self) -> Vectorised:
        """(state, torque) -> ddq at instants at which no joint with dry friction is at rest."""
        return Vectorised(self.equations.moving_acceleration())

    @cached_property
    def shown(self) -> Vectorised:
        """(state, ddq) -> q, dq, ddq that the encoders show."""
        return Vectorised(self.equations.shown())


_PROGRAMS: OrderedDict[tuple[object, ...], Program] = OrderedDict()


def program_of(robot: Robot, physics: Sequence[Physics], servo: Servo, step: float) -> Program:
    """Return the program of a robot with such phenomena, whatever their values; the latest ones are kept."""
    gains = tuple(values.tobytes() for values in (servo.kp, servo.kd, servo.limit))
    # The robot is held by its program, so that its identity stays its own.
    key = (id(robot), gains, step, tuple(p.structure for p in physics))
    if key not in _PROGRAMS:
        _PROGRAMS[key] = Program(Equations(robot, tuple(physics), servo, step))
        if len(_PROGRAMS) > KEPT:
            _PROGRAMS.popitem(last=False)
    _PROGRAMS.move_to_end(key)
    return _PROGRAMS[key]
