"""Friction of the simulated robot."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Motion
from robot_ident.testbed.phenomena.phenomenon import (
    Contribution,
    Instant,
    Physics,
    Value,
    between,
    damping,
    dry_friction,
    either_sign,
    even,
    full_speed,
    log_even,
    one_of,
    strength,
    times,
    usual_damping,
)


class Viscous(Physics):
    """Friction b dq, taken implicitly (trapezoidal rule)."""

    name = "viscous"
    parameters = (Value("viscous", "Nm s/rad", "N s/m", lower=0.0, usual=usual_damping),)

    def contribution(self, x: Instant) -> Contribution:
        """Return the damping b."""
        return Contribution(damping={self.joint: self.values["viscous"]})


class Coulomb(Physics):
    """Dry friction c Sgn(dq), set-valued at standstill: the joint doesn't move at all until its torque exceeds c."""

    name = "coulomb"
    parameters = (Value("coulomb", "Nm", "N", lower=0.0, usual=times(0.05, strength)),)

    def contribution(self, x: Instant) -> Contribution:
        """Return the level c."""
        return Contribution(friction={self.joint: self.values["coulomb"]})


class Stribeck(Physics):
    """More dry friction at low speed: the level rises by f sech((|dq| / vs)^d), so that a joint breaks away with a
    jerk.

    f [Nm] at standstill, vs [rad/s], d: flat at the top, falling exponentially (Makkar et al. 2005 use the same
    family).
    """

    name = "stribeck"
    parameters = (
        Value("stribeck", "Nm", "N", lower=0.0, usual=times(0.03, strength)),
        Value("speed", "rad/s", "m/s", lower=1e-6, usual=0.08, drawn=log_even(0.03, 0.3)),
        Value("exponent", "1", "1", lower=0.1, upper=4.0, usual=1.0, drawn=log_even(0.6, 1.2)),
    )
    largest = 3.0

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at the joint's speed."""
        ratio = ca.fabs(x.v[self.joint]) / self.values["speed"]
        bent = ca.exp(-ca.fmin(ratio ** self.values["exponent"], 300.0))
        return Contribution(friction={self.joint: self.values["stribeck"] * 2 * bent / (1 + bent**2)})


class ViscousNonlinear(Physics):
    """Grease that thins under shear, f asinh(dq / v0) / asinh(vm / v0) (Eyring 1936), and churning oil, g dq |dq| /
    vm^2.

    f, g [Nm]: each at the joint's full speed vm.
    """

    name = "viscous_nonlinear"
    parameters = (
        Value("viscous_nonlinear", "Nm", "N", lower=0.0, usual=times(0.03, strength)),
        Value("churning", "Nm", "N", lower=0.0),
        Value("speed", "rad/s", "m/s", lower=1e-4, usual=lambda robot, joint: full_speed(robot, joint) / 12),
    )
    largest = 4.0
    sizes = ("viscous_nonlinear", "churning")

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return one of the two; thinning sets in between a thirtieth and a quarter of the full speed."""
        size, fast = 0.03 * strength(robot, joint), full_speed(robot, joint)
        speed = between(rng, fast / 30, fast / 4)
        if rng.random() < 0.6:
            return {"viscous_nonlinear": size, "churning": 0.0, "speed": speed}
        return {"viscous_nonlinear": 0.0, "churning": size, "speed": speed}

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque against the motion."""
        v, fast, v0 = x.v[self.joint], full_speed(self.robot, self.joint), self.values["speed"]
        thinning = self.values["viscous_nonlinear"] * _asinh(v / v0) / _asinh(fast / v0)
        return Contribution(torque={self.joint: thinning + self.values["churning"] * v * ca.fabs(v) / fast**2})


def _asinh(x: object) -> object:
    """Return asinh by logarithms, odd to the last bit."""
    size = ca.fabs(x)
    return ca.sign(x) * ca.log(size + ca.sqrt(size**2 + 1))


EDGE = 0.005
"""Speed [rad/s] over which one direction's friction passes into the other's."""


class ViscousAsymmetric(Physics):
    """Viscous friction larger in one direction by twice `viscous_asymmetric`: a (sqrt(dq^2 + e^2) - e)."""

    name = "viscous_asymmetric"
    parameters = (Value("viscous_asymmetric", "Nm s/rad", "N s/m", usual=times(0.15, damping), drawn=either_sign),)
    largest = 3.0

    def contribution(self, x: Instant) -> Contribution:
        """Return the torque, even in velocity."""
        v = x.v[self.joint]
        return Contribution(torque={self.joint: self.values["viscous_asymmetric"] * (ca.sqrt(v**2 + EDGE**2) - EDGE)})


class LoadFriction(Physics):
    """Teeth that are pressed together rub more: the level rises by eta (sqrt(tauL^2 + e^2) - e).

    tauL [Nm]: torque on the gear without its rotor's inertia, e [Nm]: preload below which load hardly matters, eta the
    gear's loss as a share of the load.
    """

    name = "load_friction"
    parameters = (
        Value("load_friction", "1", "1", lower=0.0, upper=0.9, usual=0.06),
        Value("preload", "Nm", "N", lower=0.0, usual=times(0.01, strength)),
    )
    largest = 2.5

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at this load."""
        e = self.values["preload"]
        carried = ca.sqrt(x.load[self.joint] ** 2 + e**2 + 1e-12) - e
        return Contribution(friction={self.joint: self.values["load_friction"] * ca.fmax(carried, 0)})


class PositionFriction(Physics):
    """A joint that runs hard over a part of its turn: the level rises by f exp(k (cos(h (q - q0)) - 1)).

    f [Nm] at q0 [rad], h how often a turn, k how narrow: the higher k, the stronger the harmonics beyond the first.
    """

    name = "position_friction"
    needs = "turning"
    parameters = (
        Value("position_friction", "Nm", "N", lower=0.0, usual=times(0.5, dry_friction)),
        Value("position", "rad", "m", usual=0.3, drawn=even(-np.pi, np.pi)),
        Value("harmonic", "1", "1/m", lower=0.1, usual=1.0, drawn=one_of(1.0, 2.0)),
        Value("narrowness", "1", "1", lower=0.01, upper=20.0, usual=0.7, drawn=log_even(0.3, 1.0)),
    )
    largest = 2.5

    def contribution(self, x: Instant) -> Contribution:
        """Return the level at this position."""
        angle = self.values["harmonic"] * (x.q[self.joint] - self.values["position"])
        level = self.values["position_friction"] * ca.exp(self.values["narrowness"] * (ca.cos(angle) - 1))
        return Contribution(friction={self.joint: level})


@dataclass(frozen=True)
class MaxwellSlip:
    """Elements with equal shares of a force level, which slip at `reaches` (Iwan 1966; Al-Bender et al. 2005).

    Element i holds its stretch z_i in [-reach_i, reach_i] and follows the joint in between: a play operator, exact for
    steps of any length. It dissipates whatever the motion, and depends on the path alone, not on speed. With a
    clearance, z_i is how far the joint stands from where the element is not touched, and `free` of it is no stretch.
    """

    level: Any
    reaches: Sequence[Any]
    free: Any = 0.0

    def stretched(self, stretch: Sequence[Any], moved: Any) -> list[Any]:
        """Return the stretches after the joint has moved."""
        ends = [self.free + reach for reach in self.reaches]
        return [ca.fmax(ca.fmin(z + moved, end), -end) for z, end in zip(stretch, ends, strict=True)]

    def force(self, stretch: Sequence[Any]) -> Any:
        """Return the force against the motion."""
        share = self.level / len(self.reaches)
        touched = [ca.fmax(z - self.free, 0) - ca.fmax(-z - self.free, 0) for z in stretch]
        return sum((share * z / reach for z, reach in zip(touched, self.reaches, strict=True)), start=0.0)

    def stiffness(self, stretch: Sequence[Any], moved: Any) -> Any:
        """Return how the force rises with the motion: of elements that are touched and don't slip."""
        share, total = self.level / len(self.reaches), 0.0
        for z, reach in zip(stretch, self.reaches, strict=True):
            beyond = ca.fabs(z + moved) - self.free
            total += ca.if_else(ca.logic_and(beyond >= 0, beyond < reach), share / reach, 0)
        return total


class Bristles(Physics):
    """Maxwell elements between joint and housing, which a subclass states in `elements`."""

    @abstractmethod
    def elements(self) -> MaxwellSlip:
        """Return the elements."""

    def contribution(self, x: Instant) -> Contribution:
        """Return the force of the bristles, stretched to the middle of the step."""
        elements, moved = self.elements(), x.moved[self.joint]
        return Contribution(
            torque={self.joint: elements.force(elements.stretched(x.state, moved))},
            stiffness={self.joint: elements.stiffness(x.state, moved)},
        )

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return the stretches after the step."""
        return self.elements().stretched(before.state, after.q[self.joint] - before.q[self.joint])


SPREAD = (0.12, 0.3, 0.6, 1.1, 2.0)
"""Reaches of the elements over the mean reach: the friction curve bends gradually."""


class Presliding(Bristles):
    """Bristles in place of sharp Coulomb friction: after a reversal friction builds up over a distance.

    Five Maxwell elements share the Coulomb level c; `reach` [rad] is the mean distance at which they slip.
    """

    name = "presliding"
    parameters = (
        Value("reach", "rad", "m", lower=1e-6, usual=0.005, drawn=log_even(0.002, 0.015)),
        Value("coulomb", "Nm", "N", lower=0.0, usual=dry_friction),
    )
    states = len(SPREAD)
    largest = 4.0
    smallest = 0.1
    replaces = ("coulomb",)

    def elements(self) -> MaxwellSlip:
        """Return those that share the Coulomb level."""
        return MaxwellSlip(self.values["coulomb"], [self.values["reach"] * share for share in SPREAD])


class FrictionBehindPlay(Bristles):
    """A dry slide that is dragged through a clearance `gap` [rad], beside the joint's own friction.

    Once it is touched, bristles bend before it slides: as in `Presliding`, over a mean distance `reach` [rad] up to
    `level` [Nm].
    """

    name = "friction_behind_play"
    parameters = (
        Value("level", "Nm", "N", lower=0.0, usual=dry_friction),
        Value("gap", "rad", "m", lower=1e-6, usual=0.02),
        Value("reach", "rad", "m", lower=1e-6, usual=0.001),
    )
    states = len(SPREAD)
    largest = 3.0

    @classmethod
    def draw(cls, robot: Robot, joint: int, rng: np.random.Generator, motion: Motion) -> dict[str, float]:
        """Return a gap from 5 to 50 mrad, and bristles of a fiftieth to a fifth of it."""
        gap = between(rng, 0.005, 0.05)
        return cls.typical(robot, joint) | {"gap": gap, "reach": gap * between(rng, 0.02, 0.2)}

    def elements(self) -> MaxwellSlip:
        """Return those behind the clearance."""
        reaches = [self.values["reach"] * share for share in SPREAD]
        return MaxwellSlip(self.values["level"], reaches, self.values["gap"] / 2)


STOPPED = 1e12
"""Time constant [s] with which a temperature is held."""


class TemperatureDrift(Physics):
    """Grease thins as it warms up: damping falls by f (1 - exp(-t / T)), f [Nm s/rad], T [s].

    Its state is the share of the warming that is done; every recording begins cold, with the robot's own viscous
    friction.
    """

    name = "temperature_drift"
    parameters = (
        Value("temperature_drift", "Nm s/rad", "N s/m", usual=times(0.3, damping)),
        Value("time_constant", "s", "s", lower=1e-3, usual=60.0, drawn=log_even(30.0, 150.0)),
    )
    states = 1
    largest = 2.0
    slow = True
    done = 0.0

    def rest(self) -> list[float]:
        """Return the share of the warming that is done at the start."""
        return [self.done]

    def contribution(self, x: Instant) -> Contribution:
        """Return the fall of the damping."""
        return Contribution(damping={self.joint: -self.values["temperature_drift"] * x.state[0]})

    def advance(self, before: Instant, after: Instant, h: float) -> list[Any]:
        """Return the share that is done after the step."""
        return [1 - (1 - before.state[0]) * ca.exp(-h / self.values["time_constant"])]

    def held(self, share: float) -> Self:
        """Return the friction of one temperature."""
        other = type(self)(self.robot, self.place, {**self.values, "time_constant": STOPPED})
        other.done = share
        return other

    def share(self, t: Array) -> Array:
        """Return the share of the warming that is done after times t."""
        return np.asarray(1 - (1 - self.done) * np.exp(-t / self.values["time_constant"]))
