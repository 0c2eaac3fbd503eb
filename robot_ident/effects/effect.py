"""What a physical effect is: its torque columns, written once for numbers and for CasADi expressions."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.motion import Array, Motion
from robot_ident.robot.robot import Robot

Symmetry = Literal["dissipative", "conservative", "memory"]


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
    """A linear parameter of an effect: tau = ... + value * column.

    unit on a revolute, unit_prismatic on a prismatic joint. positive: a negative value has no physical meaning.
    """

    name: str
    unit: str
    unit_prismatic: str
    positive: bool = False


@dataclass(frozen=True)
class Inner:
    """A parameter inside a column, which is searched: on `grid` first, then refined between `lower` and `upper`.

    continuous: False where only the values of the grid have a meaning.
    """

    name: str
    unit: str
    unit_prismatic: str
    lower: float
    upper: float
    grid: tuple[float, ...]
    continuous: bool = True


class Torques(NamedTuple):
    """Torques of a model along a motion [N, n] Nm, for effects that depend on them.

    load: what the gear carries (links, springs). total: the whole model but for effects that themselves depend on
    torque.
    """

    load: Array
    total: Array


@dataclass(frozen=True)
class Signals:
    """What columns depend on: q, dq, ddq by joint, each [N] (numbers) or a scalar expression; load and total torque
    likewise.
    """

    q: Sequence[Any]
    dq: Sequence[Any]
    ddq: Sequence[Any]
    load: Sequence[Any] = ()
    total: Sequence[Any] = ()

    @classmethod
    def of(cls, motion: Motion, torques: Torques | None = None) -> Signals:
        """Return the signals of a motion."""
        load, total = ((), ()) if torques is None else (list(torques.load.T), list(torques.total.T))
        return cls(list(motion.q.T), list(motion.dq.T), list(motion.ddq.T), load, total)


class Effect(ABC):
    """A physical effect, at one joint of a robot or (scope `robot`) on all of it.

    A subclass states its data as class attributes and its equation in `terms`, or, where it has memory, in `columns`;
    regressor columns, gradients, names, units and documentation follow from them.

    equation, meaning: for reports. coefficients, inner: its parameters. symmetry: what reversal of time does to it.
    signature: what it looks like in a residual. confused_with: effects that resemble it; experiment: the one that
    tells. magnitude: what is usual, an industrial arm / a cobot. loads_gear: the gear carries its torque.
    uses_torque: its columns depend on the model's torque. symbolic: `terms` works on expressions, so that excitations
    can be designed for it.
    """

    name: ClassVar[str]
    equation: ClassVar[str]
    meaning: ClassVar[str]
    coefficients: ClassVar[tuple[Coefficient, ...]]
    inner: ClassVar[tuple[Inner, ...]] = ()
    symmetry: ClassVar[Symmetry]
    signature: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str] = ""
    magnitude: ClassVar[str] = ""
    scope: ClassVar[Literal["joint", "robot"]] = "joint"
    loads_gear: ClassVar[bool] = False
    uses_torque: ClassVar[bool] = False
    symbolic: ClassVar[bool] = True

    def __init__(self, robot: Robot, joint: int, setting: Mapping[str, float] | None = None) -> None:
        """Place the effect at a joint (any where the scope is the robot), inner parameters as told or in mid-grid."""
        self.robot = robot
        self.joint = joint
        self.setting = {inner.name: inner.grid[len(inner.grid) // 2] for inner in self.inner} | dict(setting or {})
        for key in self.setting:
            if key not in {inner.name for inner in self.inner}:
                raise InputError(f"{self.label} has no inner parameter {key!r}{did_you_mean(key, self.setting)}")

    def terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return for each coefficient the torque per unit: {joint: [N]}."""
        raise InputError(f"{self.label} depends on the past; it can't be written as an expression of the present state")

    def columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the torque per unit of each coefficient [N, n, k]."""
        out = np.zeros((motion.samples, self.robot.n, len(self.coefficients)))
        for k, term in enumerate(self.terms(Signals.of(motion, torques), np)):
            for joint, values in term.items():
                out[:, joint, k] = values
        return out

    def at(self, setting: Mapping[str, float]) -> Effect:
        """Return the same effect with other inner parameters."""
        return type(self)(self.robot, self.joint, {**self.setting, **setting})

    def settings(self) -> Sequence[dict[str, float]]:
        """Return the inner parameters to search: every combination of their grids."""
        names = [inner.name for inner in self.inner]
        return [dict(zip(names, values, strict=True)) for values in product(*(inner.grid for inner in self.inner))]

    @property
    def place(self) -> str | None:
        """Name of its joint, None where its scope is the robot."""
        return None if self.scope == "robot" else self.robot.joints[self.joint]

    @property
    def label(self) -> str:
        """The effect as users write it: `name@joint`."""
        return self.name if self.place is None else f"{self.name}@{self.place}"

    def parameter_names(self) -> tuple[str, ...]:
        """Return the names of its coefficients: the label, or `name.coefficient@joint` where it has several
        parameters.
        """
        if len(self.coefficients) + len(self.inner) == 1:
            return (self.label,)
        return tuple(self._named(c.name) for c in self.coefficients)

    def inner_names(self) -> tuple[str, ...]:
        """Return the names of its inner parameters: `name.inner@joint`."""
        return tuple(self._named(inner.name) for inner in self.inner)

    def _named(self, parameter: str) -> str:
        return f"{self.name}.{parameter}" + ("" if self.place is None else f"@{self.place}")

    def parameter_units(self) -> tuple[str, ...]:
        """Return the units of its coefficients."""
        return tuple(c.unit_prismatic if self._prismatic else c.unit for c in self.coefficients)

    def inner_units(self) -> tuple[str, ...]:
        """Return the units of its inner parameters."""
        return tuple(inner.unit_prismatic if self._prismatic else inner.unit for inner in self.inner)

    @property
    def _prismatic(self) -> bool:
        return self.robot.prismatic[self.joint]

    def truth(self) -> dict[str, float] | None:
        """Return the true values of this effect in the simulated robot, or None where it has none."""
        values = self.robot.simulation.get(self.name, {}).get(self.robot.joints[self.joint])
        return None if values is None else dict(values)

    def absorbed(self, x: Signals, m: Mathematics, truth: dict[str, float]) -> dict[int, Any]:
        """Return the part of the true torque that merges with rigid-body parameters: {joint: [N]}."""
        return {}

    def coefficient_values(self, truth: dict[str, float]) -> list[float]:
        """Return the coefficients that belong to true values of the plant; InputError when one is missing."""
        missing = [c.name for c in self.coefficients if c.name not in truth]
        if missing:
            raise InputError(f"robot {self.robot.name}: simulation.{self.name} lacks {missing[0]!r}")
        return [truth[c.name] for c in self.coefficients]
