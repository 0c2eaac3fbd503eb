"""What a physical effect is: its torque columns, written once for numbers and for CasADi expressions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np

from robot_ident.errors import InputError
from robot_ident.motion import Array, Motion
from robot_ident.robot.robot import Robot


class Mathematics(Protocol):
    """The functions that an equation may use; numpy and casadi both offer them under these names."""

    sin: Any
    cos: Any
    exp: Any
    sqrt: Any
    sign: Any
    fabs: Any
    tanh: Any


@dataclass(frozen=True)
class Coefficient:
    """A linear parameter of an effect: tau = ... + value * column. `unit` on a revolute, `unit_prismatic` on a
    prismatic joint.
    """

    name: str
    unit: str
    unit_prismatic: str


@dataclass(frozen=True)
class Signals:
    """What columns depend on: q, dq, ddq by joint, each [N] (numbers) or scalar expressions."""

    q: Sequence[Any]
    dq: Sequence[Any]
    ddq: Sequence[Any]

    @classmethod
    def of(cls, motion: Motion) -> Signals:
        """Return the signals of a motion."""
        return cls(list(motion.q.T), list(motion.dq.T), list(motion.ddq.T))


class Effect(ABC):
    """A physical effect at one joint of a robot.

    A subclass states its data as class attributes and its equation in `terms`; regressor columns, gradients, names,
    units and documentation follow from them.
    """

    name: ClassVar[str]
    equation: ClassVar[str]
    meaning: ClassVar[str]
    coefficients: ClassVar[tuple[Coefficient, ...]]

    def __init__(self, robot: Robot, joint: int) -> None:
        """Place the effect at a joint of a robot."""
        self.robot = robot
        self.joint = joint

    @abstractmethod
    def terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return for each coefficient the torque per unit: {joint: [N]}."""

    @property
    def label(self) -> str:
        """The effect as users write it: `name@joint`."""
        return f"{self.name}@{self.robot.joints[self.joint]}"

    def parameter_names(self) -> tuple[str, ...]:
        """Return the names of its parameters: the label, or `name.coefficient@joint` where there are several."""
        if len(self.coefficients) == 1:
            return (self.label,)
        return tuple(f"{self.name}.{c.name}@{self.robot.joints[self.joint]}" for c in self.coefficients)

    def parameter_units(self) -> tuple[str, ...]:
        """Return their units."""
        prismatic = self.robot.prismatic[self.joint]
        return tuple(c.unit_prismatic if prismatic else c.unit for c in self.coefficients)

    def columns(self, motion: Motion) -> Array:
        """Return the torque per unit of each coefficient [N, n, k]."""
        out = np.zeros((motion.samples, self.robot.n, len(self.coefficients)))
        for k, term in enumerate(self.terms(Signals.of(motion), np)):
            for joint, values in term.items():
                out[:, joint, k] = values
        return out

    def truth(self) -> dict[str, float] | None:
        """Return the true values of this effect in the simulated robot, or None where it has none."""
        values = self.robot.simulation.get(self.name, {}).get(self.robot.joints[self.joint])
        return None if values is None else dict(values)

    def absorbed(self, x: Signals, m: Mathematics, truth: dict[str, float]) -> dict[int, Any]:
        """Return the part of the true torque that merges with rigid-body parameters: {joint: [N]}."""
        return {}

    def coefficient_values(self, truth: dict[str, float]) -> list[float]:
        """Return the coefficients that belong to the plant's true values of this effect; InputError when one is
        missing.
        """
        missing = [c.name for c in self.coefficients if c.name not in truth]
        if missing:
            raise InputError(f"robot {self.robot.name}: simulation.{self.name} lacks {missing[0]!r}")
        return [truth[c.name] for c in self.coefficients]
