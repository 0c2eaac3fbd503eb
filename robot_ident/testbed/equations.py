"""The equations of one time step as CasADi functions: all that happens to the simulated arm between two instants.

The state is a vector with names for its parts; the step is compiled once for all values of the robot's parameters.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice, pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from robot_ident.robot.robot import Robot
from robot_ident.signals.motion import Array, Mask
from robot_ident.testbed.dry_friction import StepProblem, solve
from robot_ident.testbed.links import links_function
from robot_ident.testbed.phenomena.phenomenon import Instant, Physics
from robot_ident.testbed.servo import Servo
from robot_ident.testbed.transmissions import Transmissions
from robot_ident.testbed.vectorised import on_memory, vectorised


class Parts(NamedTuple):
    """The parts of a state.

    q rad, v rad/s, a rad/s^2: of the joints (their motors), then of links behind a transmission that gives; a is the
    mean acceleration of the last step, which predicts the next one. own: states of the phenomena. values: their
    parameters, which don't change.
    """

    q: Any
    v: Any
    a: Any
    own: Any
    values: Any


@dataclass(frozen=True)
class Layout:
    """Where the parts stand: three of n joints and `links` further links, `own` states and `values` parameters."""

    n: int
    own: int
    links: int = 0
    values: int = 0

    @property
    def moving(self) -> int:
        """Number of coordinates that move."""
        return self.n + self.links

    @property
    def size(self) -> int:
        """Length of a state."""
        return 3 * self.moving + self.own + self.values

    def split(self, states: Any) -> Parts:
        """Return the parts of a state [size], of numbers or expressions, or of states [N, size]."""
        m = self.moving
        slices = [slice(a, b) for a, b in pairwise([0, m, 2 * m, 3 * m, 3 * m + self.own, self.size])]
        return Parts(*(states[..., part] if isinstance(states, np.ndarray) else states[part] for part in slices))

    def joints(self, states: Array) -> Parts:
        """Return the parts with q, v, a of the joints alone."""
        parts = self.split(states)
        return parts._replace(q=parts.q[..., : self.n], v=parts.v[..., : self.n], a=parts.a[..., : self.n])


AT_ONCE = 1e-9
"""A step [s] so short that the law of friction over it is the law at an instant."""


class Terms(NamedTuple):
    """The terms of inertia ddq + bias + torque + damping dq + friction = tau at an instant, of friction its level.

    stiff: what the torque rises with position, per joint; shafts: how that of shafts rises with the step's
    acceleration; load: torque on the gears.
    """

    inertia: Any
    bias: Any
    torque: Any
    damping: Any
    stiff: Any
    shafts: Any
    level: Any
    load: Sequence[Any]


@dataclass(frozen=True)
class Equations:
    """M(q) ddq + n(q, dq) + phenomena = tau over a step of `step` seconds, theta = 1/2.

    M and n at the middle of the step, which the last acceleration predicts; servo gains, damping, stiff springs and
    shafts by the trapezoidal rule, so that a step is stable whatever they are. Parameters of phenomena are part of the
    state: the same functions, each made when it is first needed, serve all their values.
    """

    robot: Robot
    physics: tuple[Physics, ...]
    servo: Servo
    step: float
    _folded: dict[tuple[str, int], Callable[..., None]] = field(default_factory=dict, repr=False, compare=False)

    @cached_property
    def layout(self) -> Layout:
        """Where things stand in a state."""
        own, values = sum(p.states for p in self.physics), sum(len(p.free) for p in self.physics)
        return Layout(self.robot.n, own, len(self.transmissions.joints), values)

    @cached_property
    def transmissions(self) -> Transmissions:
        """The joints whose transmission gives."""
        return Transmissions.of(self.robot, self.physics)

    @cached_property
    def _links(self) -> Any:
        return links_function(self.robot)

    @cached_property
    def dry(self) -> Mask:
        """Which coordinates have dry friction [moving]."""
        _, _, parts = self._symbols()
        level = self._terms(self._given(parts), parts, parts.q, parts.v, ca.SX.zeros(self.robot.n), 0.0).level
        return np.array([not level[j].is_zero() for j in range(self.layout.moving)])

    @cached_property
    def full(self) -> Any:
        """The function (state, command) -> state after a step, stick and slip and turning in it."""
        state, command, parts = self._symbols()
        problem, load = self._step(parts, command)
        _, _, v = solve(problem)
        return ca.Function("full", [state, command], [self._after(parts, v, load)])

    @cached_property
    def slipping(self) -> Any:
        """The same function for a step in which no joint with dry friction stops or turns: a third of the work.

        Wherever the signs of the velocities come out as they went in, it is the one solution of the full problem.
        """
        state, command, parts = self._symbols()
        problem, load = self._step(parts, command)
        d, lt, p = ca.ldl(problem.inertia)
        v = parts.v + self.step * ca.ldl_solve(problem.force - problem.level * ca.sign(parts.v), d, lt, p)
        return ca.Function("slipping", [state, command], [self._after(parts, v, load)])

    def fold(self, kind: str, size: int) -> Callable[..., None]:
        """Return what runs the step `full` or `slipping` `size` times.

        It takes a state, commands [size, 5 n] and an array for the states after each step, all contiguous.
        """
        if (kind, size) not in self._folded:
            self._folded[kind, size] = on_memory(getattr(self, kind).mapaccum(f"{kind}_{size}", size))
        return self._folded[kind, size]

    @cached_property
    def acceleration(self) -> Callable[..., tuple[Array, ...]]:
        """The function (state, torque) -> ddq at that instant, zero for joints that stick."""
        state, _, parts = self._symbols()
        tau = ca.SX.sym("tau", self.robot.n)
        terms = self._terms(self._given(parts), parts, parts.q, parts.v, tau, 0.0)
        force = self._driven(tau) - terms.bias - terms.torque - terms.damping * parts.v
        nothing = ca.SX.zeros(self.layout.moving)
        problem = StepProblem(terms.inertia, force, parts.v, terms.level, AT_ONCE, nothing, nothing)
        _, w, after = solve(problem)
        sticks = ca.logic_and(parts.v == 0, after == 0)
        return vectorised(ca.Function("acceleration", [state, tau], [ca.densify(ca.if_else(sticks, 0, w))]))

    @cached_property
    def shown(self) -> Callable[..., tuple[Array, ...]]:
        """The function (state, ddq) -> position, velocity and acceleration [n] that the encoders show."""
        state, _, parts = self._symbols()
        n = self.robot.n
        true = (parts.q[:n], parts.v[:n], ca.SX.sym("ddq", n))
        out = [ca.densify(x + more) for x, more in zip(true, self._misread(self._given(parts), *true), strict=True)]
        return vectorised(ca.Function("shown", [state, true[2]], out))

    def _symbols(self) -> tuple[Any, Any, Parts]:
        state = ca.SX.sym("x", self.layout.size)
        return state, ca.SX.sym("u", 5 * self.robot.n), self.layout.split(state)

    def _given(self, x: Parts) -> tuple[Physics, ...]:
        """Return the phenomena with their parameters as the state holds them."""
        values = iter(ca.vertsplit(x.values) if self.layout.values else [])
        return tuple(p.with_symbols(list(islice(values, len(p.free)))) for p in self.physics)

    def _own(self, x: Parts) -> list[Sequence[Any]]:
        """Return the states of each phenomenon."""
        own = iter(ca.vertsplit(x.own) if self.layout.own else [])
        return [list(islice(own, p.states)) for p in self.physics]

    def _driven(self, tau: Any) -> Any:
        """Return a torque of the motors [n] with zeros for the links behind them."""
        return ca.vertcat(tau, ca.SX.zeros(self.layout.links))

    def _misread(self, given: Sequence[Physics], q: Any, v: Any, a: Any) -> tuple[Any, Any, Any]:
        """Return what the encoders show too much of positions, velocities and accelerations [n]."""
        off, slip, bend = (ca.SX.zeros(q.numel()) for _ in range(3))
        for physics in given:
            if physics.reads:
                angle, j = ca.SX.sym("angle"), physics.joint
                error = physics.misread(angle)
                slope = ca.gradient(error, angle)
                parts = ca.substitute([error, slope, ca.gradient(slope, angle)], [angle], [q[j]])
                off[j] += parts[0]
                slip[j] += parts[1] * v[j]
                bend[j] += parts[2] * v[j] ** 2 + parts[1] * a[j]
        return off, slip, bend

    def _terms(self, given: Sequence[Physics], x: Parts, q: Any, v: Any, tau: Any, h: float) -> Terms:
        """Return the terms at positions and velocities, for phenomena with the states of x and commands tau [n]."""
        n, size, gear = self.robot.n, self.layout.moving, self.transmissions
        mass, bias = self._links(gear.of_links(q), gear.of_links(v))
        inertia = gear.spread(mass)
        torque, damping, stiff, level = (ca.SX.zeros(size) for _ in range(4))
        load = ca.mtimes(mass, gear.of_links(x.a)) + bias - ca.DM(self.robot.drives.armature) * gear.of_links(x.a)
        sides = {
            "motor": (q[:n], v[:n], x.a[:n], x.v[:n]),
            "link": tuple(gear.of_links(part) for part in (q, v, x.a, x.v)),
        }
        split = {side: [ca.vertsplit(part) for part in parts] for side, parts in sides.items()}
        # What the gear carries comes first: friction that depends on the load needs the sum.
        for physics, z in sorted(zip(given, self._own(x), strict=True), key=lambda pair: not pair[0].loads_gear):
            sq, sv, sa, start = split[physics.side]
            moved = [h / 2 * value for value in start]
            part = physics.contribution(Instant(sq, sv, sa, ca.vertsplit(load), z, ca.vertsplit(tau), moved, h))
            at = gear.rows[physics.side]
            for j, value in part.torque.items():
                torque[at[j]] += value
                load[j] += value if physics.loads_gear else 0
            for into, values in ((damping, part.damping), (stiff, part.stiffness), (level, part.friction)):
                for j, value in values.items():
                    into[at[j]] += value
            for (i, j), value in part.inertia.items():
                inertia[at[i], at[j]] += value
                load[i] += value * sa[j] if physics.loads_gear else 0
        full = ca.SX.zeros(size)
        full[gear.rows["link"]] += bias
        taken, shafts = gear.shafts(given, x.q, x.v, h)
        # Phenomena lower a level no further than to zero; structural zeros stay.
        level = ca.vertcat(*(c if c.is_zero() else ca.fmax(c, 0) for c in ca.vertsplit(level)))
        return Terms(inertia, full, torque + taken, damping, stiff, shafts, level, ca.vertsplit(load))

    def _step(self, x: Parts, command: Any) -> tuple[StepProblem, Sequence[Any]]:
        """Return what is to be solved for friction over a step, and the load of the gears."""
        h, servo, n = self.step, self.servo, self.robot.n
        given = self._given(x)
        q_ref, v_ref, ahead, jump, fraction = ca.vertsplit(command, n)
        q_mid, v_mid = x.q + h / 2 * x.v + h**2 / 8 * x.a, x.v + h / 2 * x.a
        kp, kd, limit = ca.DM(servo.kp), ca.DM(servo.kd), ca.DM(servo.limit)
        # The servo knows what the encoders show; their error is taken as constant over the step.
        off, slip, _ = self._misread(given, q_mid[:n], v_mid[:n], x.a[:n])
        wanted = ahead + kp * (q_ref - q_mid[:n] - off) + kd * (v_ref - v_mid[:n] - slip)
        free = ca.fabs(wanted) < limit  # a drive at its torque limit answers to nothing
        clipped = ca.fmax(ca.fmin(wanted, limit), -limit)
        terms = self._terms(given, x, q_mid, v_mid, clipped, h)
        trapezoidal = ahead + kp * (q_ref - x.q[:n] - off - h / 2 * x.v[:n]) + kd * (v_ref - x.v[:n] - slip)
        drive = ca.if_else(free, trapezoidal, clipped)
        held = self._driven(ca.if_else(free, h / 2 * kd + h**2 / 4 * kp, 0))
        implicit = h / 2 * terms.damping + h**2 / 4 * terms.stiff + held
        problem = StepProblem(
            inertia=terms.inertia + ca.diag(implicit) + terms.shafts,
            force=self._driven(drive) - terms.bias - terms.torque - terms.damping * x.v,
            velocity=x.v,
            level=terms.level,
            h=h,
            fraction=self._driven(fraction),
            jump=self._driven(ca.if_else(free, jump, 0)),
        )
        return problem, terms.load

    def _after(self, x: Parts, v: Any, load: Sequence[Any]) -> Any:
        """Return the state after a step from the velocity after it."""
        h, gear = self.step, self.transmissions
        q = x.q + h / 2 * (x.v + v)
        a = ca.if_else(v == 0, 0, (v - x.v) / h)  # a joint that has just stopped isn't predicted to turn
        own: list[Any] = []
        for physics, z in zip(self._given(x), self._own(x), strict=True):
            if physics.states:
                rows = gear.rows[physics.side]
                q0, v0, a0, q1, v1, a1 = ([part[k] for k in rows] for part in (x.q, x.v, x.a, q, v, a))
                own += physics.advance(Instant(q0, v0, a0, load, z), Instant(q1, v1, a1, load, z), h)
        return ca.vertcat(q, v, a, *own, x.values)


KEPT = 48
"""Equations that stay in memory: a study varies values more often than these."""


_PROGRAMS: OrderedDict[tuple[object, ...], Equations] = OrderedDict()


def equations_of(robot: Robot, physics: Sequence[Physics], servo: Servo, step: float) -> Equations:
    """Return the equations of a robot with such phenomena, whatever their values; the latest ones are kept."""
    gains = tuple(values.tobytes() for values in (servo.kp, servo.kd, servo.limit))
    # The robot is held by its equations, so that its identity stays its own.
    key = (id(robot), gains, step, tuple(p.structure for p in physics))
    if key not in _PROGRAMS:
        _PROGRAMS[key] = Equations(robot, tuple(physics), servo, step)
        if len(_PROGRAMS) > KEPT:
            _PROGRAMS.popitem(last=False)
    _PROGRAMS.move_to_end(key)
    return _PROGRAMS[key]
