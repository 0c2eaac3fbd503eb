"""What a phenomenon of the plant is: what it adds to M(q) ddq + n(q, dq) = tau, with its own states and parameters."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self

import numpy as np

from robot_ident.errors import InputError, did_you_mean
from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion


@dataclass(frozen=True)
class Value:
    """A parameter of a phenomenon: its unit on a revolute and on a prismatic joint, and its bounds.

    structural: it decides what the equations look like (a joint's index, a seed); the others may be changed without
    building them anew. usual: for a joint of that strength. drawn: as a real robot might have it, from the usual one.
    """

    name: str
    unit: str
    unit_prismatic: str
    lower: float = -np.inf
    upper: float = np.inf
    structural: bool = False
    usual: float | Callable[[Robot, int], float] = 0.0
    drawn: Callable[[np.random.Generator, float], float] | None = None


@dataclass(frozen=True)
class Instant:
    """What a phenomenon may depend on, as scalar CasADi expressions by joint.

    q, v, a: position, velocity, acceleration (that of the step before), of motors or links as the phenomenon's `side`
    is. load: torque that the gear carries. state: the phenomenon's own states. command: what the drives are told to
    give. moved: what a joint moves until the middle of the step at the velocity that it has at its beginning. h [s]:
    length of the step, 0 at an instant.
    """

    q: Sequence[Any]
    v: Sequence[Any]
    a: Sequence[Any]
    load: Sequence[Any]
    state: Sequence[Any] = ()
    command: Sequence[Any] = ()
    moved: Sequence[Any] = ()
    h: float = 0.0


@dataclass(frozen=True)
class Contribution:
    """What is added to the left side of M ddq + n = tau, by joint.

    torque [Nm]; damping [Nm s/rad], a torque in proportion to the joint's own velocity that is taken implicitly;
    stiffness [Nm/rad], how a torque given at `moved` rises with position, taken implicitly too; friction [Nm], the
    level of a dry friction against the joint's velocity; inertia {(i, j): kg m^2}, symmetric where i != j.
    """

    torque: Mapping[int, Any] = field(default_factory=dict)
    damping: Mapping[int, Any] = field(default_factory=dict)
    stiffness: Mapping[int, Any] = field(default_factory=dict)
    friction: Mapping[int, Any] = field(default_factory=dict)
    inertia: Mapping[tuple[int, int], Any] = field(default_factory=dict)

    def add_to(self, torque: Any, level: Any, v: Any, a: Any) -> None:
        """Add it to a torque and a level of dry friction [n], at an instant with velocities and accelerations [n]."""
        for j, value in self.torque.items():
            torque[j] += value
        for j, value in self.damping.items():
            torque[j] += value * v[j]
        for (i, j), value in self.inertia.items():
            torque[i] += value * a[j]
        for j, value in self.friction.items():
            level[j] += value


class Physics:
    """A phenomenon of the simulated robot, at one joint or (scope `robot`) on all of it.

    Its equations are those of the plant, coded apart from `robot_ident.effects`: what identifies a robot is not tested
    against itself. A subclass states `name` and `parameters` and writes `contribution`; one with memory also states its
    number of `states` and writes `advance`; one whose values depend on each other or on the motion writes `draw`.

    scope: where it may be; `either` means one joint or all. needs: what a joint must be. side: whether it acts on
    the motor or on the link, which differ where a transmission gives. sizes: the parameters that its torque is in
    proportion to, at least nearly; the first one unless stated. largest, smallest: factors of a usual size between
    which it is drawn. replaces: phenomena of the same joint whose place it takes. includes: phenomena of the same joint
    whose torque is part of its own, so that nothing could tell whether they are there besides. loads_gear: the gear
    carries its torque. shaft: it lies between motor and link. slow: it changes over many periods. reads: it changes
    what the encoder shows. step_rate [Hz]: how many steps a second it needs.
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Value, ...]]
    states: ClassVar[int] = 0
    scope: ClassVar[Literal["joint", "robot", "either"]] = "joint"
    needs: ClassVar[Literal["nothing", "turning", "another joint"]] = "nothing"
    side: ClassVar[Literal["motor", "link"]] = "motor"
    sizes: ClassVar[tuple[str, ...]] = ()
    largest: ClassVar[float] = 8.0
    smallest: ClassVar[float] = 0.0
    replaces: ClassVar[tuple[str, ...]] = ()
    includes: ClassVar[tuple[str, ...]] = ()
    loads_gear: ClassVar[bool] = False
    shaft: ClassVar[bool] = False
    slow: ClassVar[bool] = False
    reads: ClassVar[bool] = False
    step_rate: ClassVar[float] = 0.0

    def __init__(self, robot: Robot, joint: int | None, values: Mapping[str, float]) -> None:
        """Place it at a joint; a value that is left out is the robot's, or typical.

        InputError on an unknown or impossible one.
        """
        self.robot = robot
        self.place = joint
        values = {**self.known(robot, joint or 0), **values}
        known = {p.name: p for p in self.parameters}
        for key, value in values.items():
            if key not in known:
                raise InputError(f"{self.label}: no parameter {key!r}{did_you_mean(key, known)}")
            lower, upper = known[key].lower, known[key].upper
            if not lower <= value <= upper:
                raise InputError(f"{self.label}: {key} = {value} lies outside [{lower:g}, {upper:g}]")
        missing = any(p.name not in values for p in self.parameters)
        self.values: Mapping[str, Any] = {**(self.typical(robot, joint or 0) if missing else {}), **values}

    @property
    def joint(self) -> int:
        """The joint that it is at; 0 where it is the robot's."""
        return 0 if self.place is None else self.place

    @property
    def label(self) -> str:
        """The phenomenon as users write it: `name@joint`, or `name` where it is the robot's."""
        return self.name if self.place is None else f"{self.name}@{self.robot.joints[self.place]}"

    @property
    def text(self) -> str:
        """The phenomenon with its values, in full: `name@joint:k=v,...`."""
        values = ",".join(f"{p.name}={float(self.values[p.name])!r}" for p in self.parameters)
        return f"{self.label}:{values}" if values else self.label

    @property
    def structure(self) -> tuple[object, ...]:
        """What its equations depend on, but for values that may be changed."""
        fixed = tuple(float(self.values[p.name]) for p in self.parameters if p.structural)
        return (type(self), self.place, *fixed)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the values that may be changed without building the equations anew."""
        return tuple(p.name for p in self.parameters if not p.structural)

    def with_symbols(self, symbols: Sequence[Any]) -> Self:
        """Return it with expressions in place of its free values."""
        other = copy.copy(self)
        other.values = {**self.values, **dict(zip(self.free, symbols, strict=True))}
        return other

    def scaled(self, factor: float) -> Self:
        """Return it with its size multiplied by a factor."""
        sizes = self.sizes or (self.parameters[0].name,)
        return type(self)(self.robot, self.place, {**self.values, **{k: factor * self.values[k] for k in sizes}})

    @classmethod
    def typical(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return values of a size that is usual for a joint of that strength."""
        return {p.name: p.usual(robot, joint) if callable(p.usual) else p.usual for p in cls.parameters}

    @classmethod
    def known(cls, robot: Robot, joint: int) -> dict[str, float]:
        """Return values that the robot's description gives elsewhere, its geometry for one."""
        return {}

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return values as a real robot might have them, drawn at random.

        `motion` is how the robot will be moved: for what depends on the range or speed that is used. What `sizes` names
        is of usual size, with a random sign where both occur.
        """
        usual = cls.typical(robot, joint)
        return usual | {p.name: p.drawn(rng, usual[p.name]) for p in cls.parameters if p.drawn}

    @classmethod
    def possible(cls, robot: Robot, joint: int) -> bool:
        """Return whether it can be at this joint, and be seen there."""
        if cls.needs == "turning":
            return not robot.prismatic[joint]
        return cls.needs == "nothing" or robot.n > 1

    def contribution(self, x: Instant) -> Contribution:
        """Return what it adds at an instant; nothing where it acts as a shaft or on what is read."""
        return Contribution()

    def rest(self) -> list[float]:
        """Return its states at rest."""
        return [0.0] * self.states

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return its states after a step of h seconds; `after` holds the new q and v and the states before."""
        return list(before.state)

    def transmit(self, twist: Any, rate: Any) -> tuple[Any, Any, Any]:
        """Return what a shaft carries when it is twisted: torque [Nm], its slope [Nm/rad] and its damping
        [Nm s/rad].
        """
        raise NotImplementedError(f"{self.name} is no shaft")

    def misread(self, q: Any) -> Any:
        """Return what the encoder shows too much [rad] at a true position q."""
        return 0.0

    def lateness(self) -> float:
        """Return the time [s] by which the recorded torque is late, negative where it is early."""
        return 0.0

    def held(self, share: float) -> Self:
        """Return a slow phenomenon, held where it has run through a share of its change."""
        return self

    def share(self, t: Array) -> Array:
        """Return what share [N] of its change a slow phenomenon has run through at times t [N] s."""
        return np.zeros(np.shape(t))


def strength(robot: Robot, joint: int) -> float:
    """Return the torque [Nm or N] that a joint is built for: its limit, or what turns its inertia at 10 rad/s^2."""
    limit = float(robot.limits.torque[joint])
    return limit if np.isfinite(limit) else 10.0 * float(home_inertia(robot)[joint])


def full_speed(robot: Robot, joint: int) -> float:
    """Return the speed limit of a joint [rad/s], 1 where none is known."""
    speed = float(robot.limits.velocity[joint])
    return speed if np.isfinite(speed) else 1.0


def dry_friction(robot: Robot, joint: int) -> float:
    """Return the Coulomb friction [Nm] of a joint: the robot's own, or 5 % of its torque."""
    own = robot.simulation.get("coulomb", {}).get(robot.joints[joint], {})
    return float(own.get("coulomb", 0.0)) or 0.05 * strength(robot, joint)


def usual_damping(robot: Robot, joint: int) -> float:
    """Return viscous friction [Nm s/rad] of 5 % of a joint's torque at full speed."""
    return 0.05 * strength(robot, joint) / full_speed(robot, joint)


def damping(robot: Robot, joint: int) -> float:
    """Return the viscous friction [Nm s/rad] of a joint: the robot's own, or the usual one."""
    own = robot.simulation.get("viscous", {}).get(robot.joints[joint], {})
    return float(own.get("viscous", 0.0)) or usual_damping(robot, joint)


def neighbour(robot: Robot, joint: int) -> float:
    """Return the number, from 1, of the joint after this one, before it where it is the last."""
    return float(max(joint + 2 if joint + 1 < robot.n else joint, 1))


def arm_mass(robot: Robot) -> float:
    """Return the mass [kg] of all that moves."""
    return sum(float(inertia.mass) for inertia in list(robot.rigid.model.inertias)[1:])


def times(factor: float, of: Callable[[Robot, int], float]) -> Callable[[Robot, int], float]:
    """Return what is usual as a multiple of something that a joint has."""
    return lambda robot, joint: factor * of(robot, joint)


def either_sign(rng: np.random.Generator, size: float = 1.0) -> float:
    """Return a size, or its negative."""
    return float(rng.choice([-1.0, 1.0])) * size


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number between two positive ones, evenly over the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def log_even(low: float, high: float) -> Callable[[np.random.Generator, float], float]:
    """Return a draw between two positive numbers, evenly over the logarithm."""
    return lambda rng, _: between(rng, low, high)


def even(low: float, high: float) -> Callable[[np.random.Generator, float], float]:
    """Return a draw between two numbers."""
    return lambda rng, _: rng.uniform(low, high)


def one_of(*values: float) -> Callable[[np.random.Generator, float], float]:
    """Return a draw from some values."""
    return lambda rng, _: float(rng.choice(values))


def home_pose(robot: Robot) -> Array:
    """Return the pose [n] in the middle of the position limits, 0 where a joint has none."""
    lower, upper = robot.limits.lower, robot.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    return np.where(bounded, (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2, 0.0)


def felt_inertia(robot: Robot, q: Array) -> Array:
    """Return the diagonal [n] of M(q), armature included."""
    import pinocchio

    model = robot.rigid.model
    return np.diag(pinocchio.crba(model, model.createData(), q)).copy()


def home_inertia(robot: Robot) -> Array:
    """Return the diagonal [n] of M(q), armature included, at the home pose."""
    return felt_inertia(robot, home_pose(robot))
