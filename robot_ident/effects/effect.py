"""What a physical effect is: its torque columns, written once for numbers and for CasADi expressions."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, Self

import numpy as np

from robot_ident.effects.own import faults_of, is_own, own_columns
from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.drives import Side, in_ampere
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion

Symmetry = Literal["dissipative", "conservative", "memory", "mixed"]
"""What a column does when a motion runs backwards: its sign turns, it stays, depends on the past, or has both."""

Scope = Literal["joint", "robot", "joint_or_robot"]

DRIVE_SIDE: tuple[Side, ...] = ("motor", "joint")
EVERYWHERE: tuple[Side, ...] = (*DRIVE_SIDE, "link")
"""Friction shows on the link side, too: bearings, seals and cables lie beyond that sensor. The motor's own doesn't."""


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
    symmetry: where it differs from the effect's. largest: beyond it, in either direction, no robot is so far off.
    """

    name: str
    unit: str
    unit_prismatic: str
    positive: bool = False
    symmetry: Symmetry | None = None
    largest: float = np.inf


_RESTS = 1e-3  # of its range, or of a scale's bound: so near to it a searched value rests there


@dataclass(frozen=True)
class Inner:
    """A parameter inside a column, which is searched: on `grid` first, then refined between `lower` and `upper`.

    grid_prismatic: the grid on a prismatic joint, where it differs. continuous: False where only the values of the grid
    have a meaning. logarithmic: a scale, to be refined in its logarithm. defining: where it is zero there is no such
    effect.
    """

    name: str
    unit: str
    unit_prismatic: str
    lower: float
    upper: float
    grid: tuple[float, ...]
    grid_prismatic: tuple[float, ...] = ()
    continuous: bool = True
    logarithmic: bool = False
    defining: bool = False

    def at_bound(self, value: float) -> bool:
        """Return whether a value rests at a bound, where it says no more than that it is there or beyond."""
        if not self.continuous:
            return False
        if self.logarithmic:
            return value <= self.lower * (1.0 + _RESTS) or value >= self.upper * (1.0 - _RESTS)
        return not _RESTS < (value - self.lower) / (self.upper - self.lower) < 1.0 - _RESTS

    def at_least(self, value: float) -> bool:
        """Return whether a value rests at its lower bound, where it may as well be zero."""
        return self.at_bound(value) and value < self.middle

    def scaled(self, value: float) -> float:
        """Return a value as it is searched: of a scale, its logarithm."""
        return float(np.log(value)) if self.logarithmic else float(value)

    def unscaled(self, place: float) -> float:
        """Return the value that `scaled` brings to a place, within its bounds."""
        return float(np.clip(np.exp(place) if self.logarithmic else place, self.lower, self.upper))

    @property
    def middle(self) -> float:
        """The value in the middle of the grid."""
        return self.grid[len(self.grid) // 2]


class Sensitivity(Protocol):
    """First-order changes of the rigid arm's torque along a motion of N samples and n joints."""

    @property
    def inertia(self) -> Array:
        """Inertia matrix [N, n, n] kg m^2, rotors included."""

    def displaced(self, displacement: Motion) -> Array:
        """Return the change of torque [N, n] Nm when the links stand off by a displacement that moves along."""

    def by_joint(self, joint: int) -> tuple[Array, Array, Array]:
        """Return the derivatives [N, n] of the torque by a link's position, velocity and acceleration."""

    def gravity(self, direction: Array) -> Array:
        """Return the torque [N, n] Nm per m/s^2 of gravity in a direction [3] of the base."""

    def reported(self, torque: Array) -> Array:
        """Return a torque of the arm [N, n, ...] in the scale in which each joint reports its effort."""

    def mounted(self, joint: int) -> Array:
        """Return the change of torque [N, n, 3] Nm per metre by which a joint's origin moves along x, y, z of the frame
        before.
        """


class Torques(NamedTuple):
    """Torques of a model along a motion [N, n] Nm, for effects that depend on them.

    load: what the gear carries (links, springs). total: the whole model but for effects that themselves depend on
    torque. rigid: how the links' torque changes; None as long as the parameters aren't known. dry: the part of total
    that steps with the sign of each joint's velocity.
    """

    load: Array
    total: Array
    rigid: Sensitivity | None = None
    dry: Array | None = None


class Course(Protocol):
    """How expressions of the present state go on along a smooth motion: what is near in time, without samples.

    For designing excitations: an effect that depends on what was, or on the arm itself, is an expression all the same.
    """

    def rate(self, x: Any) -> Any:
        """Return dx/dt of an expression."""

    def at(self, x: Any, later: float) -> Any:
        """Return an expression `later` seconds from now."""

    def displaced(self, joint: int, displacement: Sequence[Any]) -> Sequence[Any]:
        """Return the change of the rigid arm's torque by joint [n] when a link stands off by a displacement, given with
        its first and second derivative along time.
        """

    def gravity(self, direction: Array) -> Sequence[Any]:
        """Return the rigid arm's torque by joint [n] per m/s^2 of gravity in a direction [3] of the base."""


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


def scaled(factor: float, torque: Sequence[Any]) -> dict[int, Any]:
    """Return the term {joint: expression} of a torque given by joint [n], times a factor."""
    return {joint: factor * value for joint, value in enumerate(torque)}


class Effect(ABC):
    """A physical effect, at one joint of a robot or (scope `robot`) on all of it.

    A subclass states its data as class attributes and its equation in `full_terms`, or, where it has memory, in
    `full_columns`; regressor columns, gradients, names, units and documentation follow from them.

    equation, meaning: for reports. coefficients, inner: its parameters (an effect at its place may have fewer).
    symmetry: what reversal of time does to it. signature: what it looks like in a residual. confused_with: effects
    that resemble it, also_like: causes that are no effects here; experiment: the one that tells. magnitude: what is
    usual, an industrial arm / a cobot. loads_gear: the gear carries its torque. steps: its torque is sign(dq) of its
    joint times something smooth. through_links: its torque reaches the drives through the links, in whose scale each
    joint reports it. uses_torque: its columns depend on the model's torque. needs_time: they depend on
    samples before or after. trends: its torque changes from one period of a motion to the next, so that the mean of
    periods tells its level alone. symbolic: `terms` works on expressions; where it doesn't, `smooth_terms` writes what
    the design of excitations takes instead. brief: its torque comes in bursts far shorter than the motion's own time
    scale. over_position: its torque is a curve over its joint's position and depends on nothing else. exact: whatever
    its formula leaves is another effect. scales_links: it multiplies its joint's rows of the links' columns and has
    none of its own. relative: it compares joints, so that one of them has to be without: the first one, where it is
    asked for on every joint. seen_from: where effort may be measured for it to show; before_sensor: why it can't
    elsewhere. contains: effects whose column it holds too -> coefficient. after: the effect without which it has no
    meaning at its place. more_than: the effect that it is but for one cause more, which is named where data can't tell
    the two.
    candidate: it may be what a model lacks. measuring: a fault of what is measured, to be put right in the robot YAML
    rather than added to the model. regression: a column shows it; else `evidence` says what does.
    """

    name: ClassVar[str]
    equation: ClassVar[str]
    meaning: ClassVar[str]
    coefficients: tuple[Coefficient, ...]
    inner: tuple[Inner, ...] = ()
    symmetry: ClassVar[Symmetry]
    signature: ClassVar[str]
    confused_with: ClassVar[tuple[str, ...]] = ()
    also_like: ClassVar[tuple[str, ...]] = ()
    experiment: ClassVar[str] = ""
    magnitude: ClassVar[str] = ""
    scope: ClassVar[Scope] = "joint"
    loads_gear: ClassVar[bool] = False
    steps: ClassVar[bool] = False
    through_links: ClassVar[bool] = False
    uses_torque: ClassVar[bool] = False
    needs_time: ClassVar[bool] = False
    trends: ClassVar[bool] = False
    symbolic: ClassVar[bool] = True
    brief: ClassVar[bool] = False
    over_position: ClassVar[bool] = False
    exact: ClassVar[bool] = False
    scales_links: ClassVar[bool] = False
    relative: ClassVar[bool] = False
    seen_from: ClassVar[tuple[Side, ...]] = EVERYWHERE
    before_sensor: ClassVar[str] = ""
    contains: ClassVar[Mapping[str, str]] = {}
    after: ClassVar[str] = ""
    more_than: ClassVar[str] = ""
    candidate: ClassVar[bool] = True
    measuring: ClassVar[bool] = False
    regression: ClassVar[bool] = True
    evidence: ClassVar[str] = ""

    def __init__(self, robot: Robot, joint: int | None, setting: Mapping[str, float] | None = None) -> None:
        """Place the effect at a joint (None: the whole robot), inner parameters as told or in mid-grid."""
        self.robot = robot
        self.whole = joint is None
        self.joint = 0 if joint is None else joint
        self.inner = self.placed_inner()
        self.setting = {inner.name: inner.middle for inner in self.inner}
        self.setting = self._with(setting or {})

    @classmethod
    def available(cls, robot: Robot, joint: int | None) -> str | None:
        """Return why a robot can't have the effect at a joint (None: on the whole of it), or None where it can."""
        return None

    @staticmethod
    def no_end(robot: Robot, joint: int | None) -> str | None:
        """Return why a joint whose positions have no limits holds no law over them; None where it has limits."""
        if joint is None or np.all(np.isfinite([robot.limits.lower[joint], robot.limits.upper[joint]])):
            return None
        return "the joint turns without end (its position has no limits)"

    def placed_inner(self) -> tuple[Inner, ...]:
        """Return the inner parameters at this place."""
        prismatic = self._prismatic
        return tuple(replace(i, grid=i.grid_prismatic) if prismatic and i.grid_prismatic else i for i in self.inner)

    def hidden_in(self, motion: Motion) -> str | None:
        """Return why data of a motion can't show the effect, or None where they can; its columns are zero there."""
        return None

    def full_terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return for each coefficient of the class the torque per unit: {joint: [N]}."""
        raise InputError(f"{self.label} depends on the past; it can't be written as an expression of the present state")

    def terms(self, x: Signals, m: Mathematics) -> Sequence[dict[int, Any]]:
        """Return for each coefficient at this place the torque per unit: {joint: [N]}."""
        with faults_of(type(self)):
            terms = self.full_terms(x, m)
        return [terms[k] for k in self._kept]

    def smooth_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return for each coefficient of the class what designs take for its torque per unit: {joint: expression}.

        Memory and delays as functions of the state that hold along smooth motions; the exact columns judge the result.
        """
        if self.symbolic:
            return self.full_terms(x, m)
        raise InputError(f"no excitation can be designed for {self.label}: its column is no function of the state")

    def designed_terms(self, x: Signals, m: Mathematics, course: Course) -> Sequence[dict[int, Any]]:
        """Return `smooth_terms` for each coefficient at this place."""
        with faults_of(type(self)):
            terms = self.smooth_terms(x, m, course)
        return [terms[k] for k in self._kept]

    def full_columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the torque per unit of each coefficient of the class [N, n, K]."""
        terms = self.full_terms(Signals.of(motion, torques), np)
        out = np.zeros((motion.samples, self.robot.n, len(terms)))
        for k, term in enumerate(terms):
            for joint, values in term.items():
                out[:, joint, k] = values
        return out

    def columns(self, motion: Motion, torques: Torques | None = None) -> Array:
        """Return the torque per unit of each coefficient [N, n, k].

        Raises InputError where they depend on the past of a set of single instants, and where a user's effect fails.
        """
        if self.needs_time and motion.dt is None:
            raise InputError(f"{self.label} depends on the past: its motion must be sampled evenly")
        if self.hidden_in(motion):
            return np.zeros((motion.samples, self.robot.n, len(self.coefficients)))
        made = own_columns(self, motion, torques) if is_own(type(self)) else self.full_columns(motion, torques)
        return made[:, :, list(self._kept)]

    def at(self, setting: Mapping[str, float]) -> Self:
        """Return the same effect with other inner parameters."""
        other = copy(self)
        other.setting = self._with(setting)
        return other

    def without(self, coefficient: str) -> Effect:
        """Return the same effect less one of its coefficients, whose column the model holds already."""
        other = copy(self)
        other.coefficients = tuple(c for c in self.coefficients if c.name != coefficient)
        return other

    def settings(self, motion: Motion | None = None) -> Sequence[dict[str, float]]:
        """Return the inner parameters to search, for a motion where their grid depends on it: every combination."""
        names = [inner.name for inner in self.inner]
        return [dict(zip(names, values, strict=True)) for values in product(*(inner.grid for inner in self.inner))]

    def contradicts_itself(
        self, values: Array, along: Sequence[tuple[Motion, Torques]], beside: Mapping[str, float]
    ) -> bool:
        """Return whether coefficients [k] at these inner parameters can't be those of one cause, on some motions and
        beside the model's linear parameters by name.
        """
        return False

    @property
    def ranges(self) -> tuple[tuple[float, float], ...]:
        """The least and the largest that each coefficient can be, at these inner parameters."""
        return tuple((0.0 if c.positive else -c.largest, c.largest) for c in self.coefficients)

    @property
    def size(self) -> int:
        """Number of its parameters, inner ones included."""
        return len(self.coefficients) + len(self.inner)

    @property
    def place(self) -> str | None:
        """Name of its joint, None where it is of the whole robot."""
        return None if self.whole else self.robot.joints[self.joint]

    @property
    def unseen(self) -> str | None:
        """Why the robot's sensors can't show it here, None where they can."""
        joints = range(self.robot.n) if self.whole else (self.joint,)
        if any(self.robot.side(joint) in self.seen_from for joint in joints):
            return None
        return f"effort is measured on the {self.robot.side(self.joint)} side: {self.before_sensor}"

    @cached_property
    def label(self) -> str:
        """The effect as users write it: `name@joint`, or `name`."""
        return self.name if self.place is None else f"{self.name}@{self.place}"

    def parameter_names(self) -> tuple[str, ...]:
        """Return the names of its coefficients: the label, or `name.coefficient@joint` where it has several
        parameters.
        """
        if self.size == 1:
            return (self.label,)
        return tuple(self._named(c.name) for c in self.coefficients)

    def inner_names(self) -> tuple[str, ...]:
        """Return the names of its inner parameters: `name.inner@joint`."""
        return tuple(self._named(inner.name) for inner in self.inner)

    def parameter_units(self) -> tuple[str, ...]:
        """Return the units of its coefficients."""
        units = (c.unit_prismatic if self._prismatic else c.unit for c in self.coefficients)
        ampere = not self.whole and self.robot.in_ampere(self.joint)
        return tuple(in_ampere(unit) if ampere else unit for unit in units)

    def inner_units(self) -> tuple[str, ...]:
        """Return the units of its inner parameters."""
        return tuple(inner.unit_prismatic if self._prismatic else inner.unit for inner in self.inner)

    def truth(self) -> dict[str, float] | None:
        """Return the true values of this effect in the simulated robot, or None where it has none."""
        values = None if self.place is None else self.robot.simulation.get(self.name, {}).get(self.place)
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

    @property
    def _prismatic(self) -> bool:
        return not self.whole and self.robot.prismatic[self.joint]

    @property
    def _kept(self) -> tuple[int, ...]:
        """Indices of the coefficients at this place among those of the class."""
        kept = {c.name for c in self.coefficients}
        return tuple(k for k, c in enumerate(type(self).coefficients) if c.name in kept)

    def _named(self, parameter: str) -> str:
        return f"{self.name}.{parameter}" + ("" if self.place is None else f"@{self.place}")

    def _with(self, setting: Mapping[str, float]) -> dict[str, float]:
        for key in setting:
            if key not in self.setting:
                raise InputError(f"{self.label} has no inner parameter {key!r}{did_you_mean(key, self.setting)}")
        return {**self.setting, **setting}
